"""Run a recipe's stages in order, for one part or a plate.

Goes in: a recipe and a folder. Comes out: a run's files. Begin with `run.py`.
"""
