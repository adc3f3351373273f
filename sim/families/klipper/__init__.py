"""Simulated Klipper firmware."""
