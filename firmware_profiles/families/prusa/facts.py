"""Facts about Prusa-Firmware, a fork of Marlin."""

from __future__ import annotations

from typing import Final

from firmware_profiles.families.family import Family
from firmware_profiles.families.marlin.facts import make_protocol

FAMILY: Final = Family("prusa", make_protocol)
