"""Solve for node pressures in a graph of conductances: branches folded, loops factorised.

Goes in: a graph's conductances and sources. Comes out: potentials of its nodes. Begin with
`conductance.py`.
"""
