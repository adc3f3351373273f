"""The firmware family of Klipper."""

from firmware_profiles.families.klipper.facts import FAMILY

__all__ = ["FAMILY"]
