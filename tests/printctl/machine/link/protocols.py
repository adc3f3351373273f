"""Construct a firmware family's link protocol as the link does."""

from __future__ import annotations

from firmware_profiles.families import LinkSetup, family_names, find_family
from firmware_profiles.families.timing import Timing
from printctl.machine.job.coordinates import places

STREAMED = tuple(name for name in family_names() if find_family(name).make_protocol)


def made_protocol(firmware: str):
    return find_family(firmware).make_protocol(LinkSetup(Timing(), 1, 128, places))
