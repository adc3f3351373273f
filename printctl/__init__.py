"""printctl."""
