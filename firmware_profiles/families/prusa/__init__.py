"""Facts about Prusa-Firmware, a fork of Marlin: commands, dialect, serial link.

Its `FAMILY` stands in `facts`. Begin with `facts.py`.
"""

from firmware_profiles.families.prusa.facts import FAMILY

__all__ = ["FAMILY"]
