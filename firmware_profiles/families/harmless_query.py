"""Bytes of one harmless query that firmware of every family answers without moving."""

from typing import Final

QUESTION: Final = b"\nN99999999 M105*23\n"
"""A line with a number far too high: families that count lines refuse it, others tell their
temperatures. It starts with a line end, to end what noise may have left open. Any tail of it that
survives a flush reads M105 or an unknown command, both harmless."""
