"""Simulated printer as a separate process: its port, its loop, its kernels in advance."""
