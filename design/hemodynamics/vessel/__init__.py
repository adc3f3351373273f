"""Lumped elements of one vessel: resistance, inertance, compliance, impedance."""
