"""Anatomy where it is wanted: trunks on guiding layers, zones, pairs and curves."""
