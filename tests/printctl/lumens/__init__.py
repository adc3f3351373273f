"""Tests of the lumen report."""
