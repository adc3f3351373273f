"""Design page of the web interface: edit recipes, run the pipeline on them, view the results.

Goes in: recipes of the workspace. Comes out: checked recipes, runs, views of runs. Begin with
`recipes.py`.
"""
