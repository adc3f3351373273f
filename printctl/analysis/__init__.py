"""Flow, oxygen, dye and films of a design or a print.

Goes in: a network or a run. Comes out: tables, pictures, films. Begin with `flow/conditions.py`.
"""
