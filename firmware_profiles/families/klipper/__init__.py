"""Klipper: firmware family package."""

from firmware_profiles.families.klipper.facts import FAMILY

__all__ = ["FAMILY"]
