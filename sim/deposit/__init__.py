"""Ink that a simulated print lays: strands from executed motion, layer by layer, as voxels."""
