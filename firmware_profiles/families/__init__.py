"""Firmware families (Marlin, Klipper…): G-code dialect, known commands, serial protocol of each.

Goes in: a printer's profile. Comes out: its `Family`, with dialect, grammar and protocol. Begin
with `family.py`.
"""

from firmware_profiles.families.family import Family, LinkSetup
from firmware_profiles.families.registry import family_names, family_of, find_family, meanings

__all__ = ["Family", "LinkSetup", "family_names", "family_of", "find_family", "meanings"]
