"""The firmware family of Smoothieware."""

from firmware_profiles.families.smoothieware.facts import FAMILY

__all__ = ["FAMILY"]
