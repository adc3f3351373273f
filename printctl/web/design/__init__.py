"""The design's room: recipes, tissue, network, layers."""
