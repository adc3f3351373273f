"""Faults planned for a simulated printer: cable, clock, gauge."""
