"""Facts about Smoothieware."""

from __future__ import annotations

from typing import Final

from firmware_profiles.families.family import Family, LinkSetup
from firmware_profiles.families.link_protocol import LinkProtocol
from firmware_profiles.families.smoothieware.protocol import SmoothieProtocol


def _make_protocol(setup: LinkSetup) -> LinkProtocol:
    return SmoothieProtocol(setup.timing)


FAMILY: Final = Family("smoothie", _make_protocol, keepalive=False, tells_steps=False)
