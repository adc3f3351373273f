"""Marlin 1.1 to 2.1: known commands, dialect, safety rules, numbered-line serial protocol.

Its `FAMILY` stands in `facts`, the link's state machine in `protocol`. Begin with `protocol.py`.
"""

from firmware_profiles.families.marlin.facts import FAMILY

__all__ = ["FAMILY"]
