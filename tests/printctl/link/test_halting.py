"""Time for which motors run on after a kill: as on a real Marlin, within 20 %."""

from __future__ import annotations

import re

import pytest

from firmware_profiles import Printer, load
from printctl.link.halting import halting_of


@pytest.mark.parametrize(
    ("speed_mm_s", "real_s"), [(7.1, 0.638), (35.4, 0.715), (70.7, 0.843), (141.0, 1.27)]
)
def test_message_tells_the_time_that_was_measured(speed_mm_s: float, real_s: float) -> None:
    """X and Y alike, 80 steps/mm (2026-11-22, ATmega2560 under simavr)."""
    halting = halting_of(load(Printer, "marlin_avr"), b"M112\n", emergency_parser=False)
    found = re.search(r"up to ([\d.]+) s", halting.told(speed_mm_s))
    assert found is not None
    assert real_s <= float(found[1]) + 0.005 <= 1.2 * real_s
