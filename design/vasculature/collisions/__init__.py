"""Find vessels of a network that come closer than the required clearance."""
