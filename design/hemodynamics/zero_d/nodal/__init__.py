"""Solve for node pressures in a graph of conductances, with or without loops.

Goes in: a graph's conductances and sources. Comes out: potentials of its nodes. Begin with
`conductance.py`.
"""
