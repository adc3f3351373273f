"""Simulated printer as a separate process: its port, its loop, its kernels in advance.

Goes in: a profile and a port. Comes out: a process that any host can print on. Begin with
`serve.py`.
"""
