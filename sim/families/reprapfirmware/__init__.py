"""Simulated RepRapFirmware."""
