"""Stage 8: the scan, from a file or simulated from what the simulated printer deposited."""
