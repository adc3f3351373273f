"""Facts about Aerotech controllers."""

from __future__ import annotations

from typing import Final

from firmware_profiles.families.family import Family

FAMILY: Final = Family("aerotech", keepalive=False, tells_steps=False, remembers=False)
