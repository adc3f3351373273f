"""toolpath."""
