"""Prusa-Firmware, a fork of Marlin: firmware family package."""

from firmware_profiles.families.prusa.facts import FAMILY

__all__ = ["FAMILY"]
