"""Facts about RepRapFirmware."""

from __future__ import annotations

from typing import Final

from firmware_profiles.families.family import Family, LinkSetup
from firmware_profiles.families.link_protocol import LinkProtocol
from firmware_profiles.families.reprapfirmware.protocol import RrfProtocol


def _make_protocol(setup: LinkSetup) -> LinkProtocol:
    return RrfProtocol(setup.places, setup.timing)


FAMILY: Final = Family("reprapfirmware", _make_protocol, keepalive=False, remembers=False)
