"""Design page of the web interface: recipes, tissue, network, layers."""
