"""Marlin 1.1 to 2.1: firmware family package.

Its `FAMILY` stands in `facts`, the link's state machine in `protocol`. Begin with `protocol.py`.
"""

from firmware_profiles.families.marlin.facts import FAMILY

__all__ = ["FAMILY"]
