"""hemodynamics."""
