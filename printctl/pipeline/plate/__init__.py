"""A run over a plate: each well's own run, the job of all, and the wells that are scanned."""
