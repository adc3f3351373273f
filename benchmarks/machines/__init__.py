"""Benchmarks of the machines that a lab owns: controllers that run files, profiles, hosts."""
