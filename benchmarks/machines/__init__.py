"""Benchmarks of the machines that a lab owns: printers behind network hosts."""
