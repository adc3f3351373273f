"""Read and write networks as CSV, JSON, NPZ, SWC, VTP and SimVascular paths; read X-CAVATE text.

Goes in: a file, or a network. Comes out: a network, or a file. Begin with `by_suffix.py`.
"""
