"""Facts about Marlin 1.1 to 2.1."""

from __future__ import annotations

from typing import Final

from firmware_profiles.families.family import Family, LinkSetup
from firmware_profiles.families.link_protocol import LinkProtocol
from firmware_profiles.families.marlin.pairing import Pairing
from firmware_profiles.families.marlin.protocol import MarlinProtocol


def make_protocol(setup: LinkSetup) -> LinkProtocol:
    """Make the state machine, with one line in flight or two."""
    two = setup.lines_in_flight == 2
    return MarlinProtocol(setup.timing, Pairing(setup.receive_buffer_bytes) if two else None)


FAMILY: Final = Family("marlin", make_protocol, verified=True)
