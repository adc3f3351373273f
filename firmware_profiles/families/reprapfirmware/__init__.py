"""The firmware family of RepRapFirmware."""

from firmware_profiles.families.reprapfirmware.facts import FAMILY

__all__ = ["FAMILY"]
