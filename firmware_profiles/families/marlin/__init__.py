"""Marlin 1.1 to 2.1: firmware family package."""

from firmware_profiles.families.marlin.facts import FAMILY

__all__ = ["FAMILY"]
