"""One vessel in a reduced model: resistance, inertance, compliance, impedance."""
