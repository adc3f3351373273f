"""Read and write networks as CSV, JSON, NPZ, SWC, VTP; write SimVascular; read X-CAVATE.

Goes in: a file, or a network. Comes out: a network, or a file. Begin with `by_suffix.py`.
"""
