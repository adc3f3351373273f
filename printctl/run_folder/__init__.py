"""Run folder: file names, manifest of stages, registration files.

Goes in: a run folder. Comes out: names of its files, and its manifest. Begin with `artefacts.py`.
"""
