"""Aerotech controllers: firmware family package.

Its `FAMILY` stands in `facts`. Begin with `facts.py`.
"""

from firmware_profiles.families.aerotech.facts import FAMILY

__all__ = ["FAMILY"]
