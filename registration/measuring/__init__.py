"""Measure a registered part: sizes, openings, geometry, verdicts."""
