"""The firmware family of Prusa-Firmware, a fork of Marlin."""

from firmware_profiles.families.prusa.facts import FAMILY

__all__ = ["FAMILY"]
