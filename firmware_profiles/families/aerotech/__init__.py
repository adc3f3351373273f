"""Aerotech motion controllers: known commands and G-code dialect; no serial link.

Its `FAMILY` stands in `facts`. Begin with `facts.py`.
"""

from firmware_profiles.families.aerotech.facts import FAMILY

__all__ = ["FAMILY"]
