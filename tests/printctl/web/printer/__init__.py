"""Tests of the Printer page."""
