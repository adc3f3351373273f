"""A network's step, compiled: what cells do, what nodes do, and both in time."""
