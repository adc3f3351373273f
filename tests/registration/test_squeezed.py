"""A squeezed section: walls go out to two sides while the lumen loses area."""

from __future__ import annotations

import numpy as np
import pytest

from registration.measuring.gauging.changes import _defects, _Series
from registration.measuring.gauging.sections import RAYS
from tests.registration.phantom import CHANNEL, block, traces


@pytest.mark.parametrize(
    ("area_mm", "kind", "out_um"), [(-0.04, "stenosis", -30), (0.02, "bulge", 50)]
)
def test_kind_size_and_wall_agree(area_mm: float, kind: str, out_um: float) -> None:
    trace = traces(block())[CHANNEL]
    n = len(trace.along)
    near = (np.arange(n) > 10) & (np.arange(n) < 16)
    wall = np.zeros((n, RAYS))
    wall[near, 0], wall[near, RAYS // 4] = 0.05, -0.03
    wall[near] *= 0.8
    wall[13] *= 1.25  # worst in the middle
    side = wall / 0.004
    side[near, RAYS // 4] = 0.0  # the wall that goes out is the surer
    change = np.where(near, area_mm, 0.0)
    series = _Series(trace, change, np.full(n, 0.004), 0.0, wall, 0 * change, side, 5.0)
    (found,) = _defects(series)
    assert (found.kind, round(found.size_um), round(found.wall_um)) == (kind, 1e3 * area_mm, out_um)
