"""Design page of the web interface: recipes, tissue, network, layers.

Goes in: recipes of the workspace. Comes out: checked recipes, runs, views of runs. Begin with
`service.py`.
"""
