"""fresh."""
