"""Widgets of the Scan page: slices, registration, result."""
