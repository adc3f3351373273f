"""Benchmarks of speed and accuracy, against other programs and against set limits."""
