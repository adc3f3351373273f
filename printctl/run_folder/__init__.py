"""A run's folder: names of its files, memory of its stages, what a registration leaves."""
