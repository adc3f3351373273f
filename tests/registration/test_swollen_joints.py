"""A joint that fills its crotch is a bulge; a way round gel beside a joint is a bridge."""

from __future__ import annotations

import numpy as np
import pytest

from registration.measuring.gauging.defect import Defect
from tests.registration.phantom import CHANNEL, block
from tests.registration.test_defects import findings, hole
from tests.slower import first_of

HEADER = 1
CORNER = np.array([1.7, 1.2, 1.3])
"""Where header and channel meet, at a right angle."""


def beside(*way: object) -> list[Defect]:
    found = findings(block(extra=hole(*way))).defects
    return [one for one in found if {one.vessel, one.other} & {HEADER, CHANNEL}]


@pytest.mark.parametrize("out", first_of([0.75, 0.9]))
def test_a_filled_crotch_is_a_bulge_as_long_as_it_reaches_out(out: float) -> None:
    """On the diagonal the designed walls meet 0.39 mm from the node."""
    tip = CORNER + (out - 0.2) / np.sqrt(2) * np.array([1.0, 1.0, 0.0])
    found = beside(tuple(CORNER), tuple(tip), 0.2)
    assert {one.kind for one in found} == {"bulge"}
    assert max(one.size_um for one in found) == pytest.approx(1e3 * (out - 0.39), abs=70)


def test_a_way_round_gel_beside_the_same_joint_is_a_bridge() -> None:
    found = beside((2.6, 1.2, 1.3), (1.7, 2.1, 1.3), 0.1)
    ways = [(one.kind, one.vessel, one.other) for one in found if one.through_gel]
    assert ways == [("bridge", HEADER, CHANNEL)]
