"""Serve the simulated printer as a separate process on a port.

Goes in: a profile and a port. Comes out: a process that any host can print on. Begin with
`serve.py`.
"""
