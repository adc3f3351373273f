"""Simulated Marlin."""
