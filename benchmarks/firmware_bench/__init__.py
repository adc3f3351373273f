"""Benchmark of the product against real firmware in simulated boards."""
