"""What one vessel is in a reduced model: resistance, inertance, compliance, impedance."""
