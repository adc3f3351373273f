"""Serve the simulated printer as a process of its own: port, loop, kernels compiled ahead.

Goes in: a profile and a port. Comes out: a process that any host can print on. Begin with
`serve.py`.
"""
