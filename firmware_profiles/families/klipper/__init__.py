"""Klipper firmware: known commands, G-code dialect, safety rules and link protocol.

Its `FAMILY` stands in `facts`. Begin with `facts.py`.
"""

from firmware_profiles.families.klipper.facts import FAMILY

__all__ = ["FAMILY"]
