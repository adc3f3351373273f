"""Simulated Marlin firmware."""
