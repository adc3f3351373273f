"""The firmware family of Aerotech controllers."""

from firmware_profiles.families.aerotech.facts import FAMILY

__all__ = ["FAMILY"]
