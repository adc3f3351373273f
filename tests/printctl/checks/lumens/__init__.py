"""Tests of the lumen checks in G-code."""
