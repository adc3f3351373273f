"""RepRapFirmware: firmware family package."""

from firmware_profiles.families.reprapfirmware.facts import FAMILY

__all__ = ["FAMILY"]
