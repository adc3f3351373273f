"""Tests of the guided way."""
