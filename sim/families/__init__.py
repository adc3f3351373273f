"""Simulators and readers of firmware families, one package each."""
