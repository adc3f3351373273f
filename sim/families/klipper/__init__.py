"""Simulated Klipper."""
