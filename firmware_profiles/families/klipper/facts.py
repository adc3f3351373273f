"""Facts about Klipper."""

from __future__ import annotations

from typing import Final

from firmware_profiles.families.family import Family, LinkSetup
from firmware_profiles.families.klipper.protocol import KlipperProtocol
from firmware_profiles.families.link_protocol import LinkProtocol


def _make_protocol(setup: LinkSetup) -> LinkProtocol:
    return KlipperProtocol(setup.timing)


FAMILY: Final = Family(
    "klipper", _make_protocol, keepalive=False, tells_steps=False, remembers=False
)
