"""Write flow cases for svZeroDSolver, svOneDSolver and svMultiPhysics.

Goes in: a network or a lumen's mesh with pulsatile conditions. Comes out: that solver's input.
Begin with `svzerod.py`.
"""
