"""Simulators and readers of firmware families: a folder for a family."""
