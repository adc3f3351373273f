"""Smooth surfaces of vessel junctions: single ones, and groups of overlapping ones."""
