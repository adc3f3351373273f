"""Exchange flow cases with svZeroDSolver, svOneDSolver, svMultiPhysics and openBF.

Goes in: a network or a lumen's mesh with pulsatile conditions, or another solver's input file.
Comes out: that solver's input, or its results. Begin with `svzerod.py`.
"""
