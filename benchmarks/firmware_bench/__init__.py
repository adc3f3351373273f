"""Benchmark of the product against real firmware on simulated controller boards."""
