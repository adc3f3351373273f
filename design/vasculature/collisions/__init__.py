"""Vessels that come too near to each other, in any network."""
