"""Smoothieware: firmware family package."""

from firmware_profiles.families.smoothieware.facts import FAMILY

__all__ = ["FAMILY"]
