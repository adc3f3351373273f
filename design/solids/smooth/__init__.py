"""Junctions of vessels as closed surfaces: alone, or in a crowd."""
