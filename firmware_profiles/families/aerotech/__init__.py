"""Aerotech controllers: firmware family package."""

from firmware_profiles.families.aerotech.facts import FAMILY

__all__ = ["FAMILY"]
