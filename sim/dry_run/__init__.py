"""Simulation of a whole G-code file without a printer: duration, path, limits, heat."""
