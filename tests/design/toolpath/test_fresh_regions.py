"""Regions with their own infill: changes only inside the region and inside walls."""

from __future__ import annotations

import numpy as np
import pytest

from design.errors import ToolpathError
from design.solids import Solid
from design.toolpath import MoveKind
from design.toolpath.fresh import Filling, FreshOptions, Region
from tests.design.toolpath.plans import fresh_toolpath
from tests.design.toolpath.shapes import as_solid, block

OPTIONS = FreshOptions(walls=1, filling=Filling(angles_deg=(0.0,)))
SOLID = as_solid(block(8, 4, 0.12))


def box(low, high):
    corner = np.array(low, dtype=float)
    return as_solid(block(*(np.array(high) - corner)).translate(corner.tolist()))


def ink(path, low, high):
    """Ink written between two x, µL; each line shared by its length there."""
    writes = path.kind == MoveKind.WRITE
    a, b = path.start[writes, 0], path.end[writes, 0]
    low_x, high_x = np.minimum(a, b), np.maximum(a, b)
    inside = np.clip(np.minimum(high_x, high) - np.maximum(low_x, low), 0, None)
    middle = (low < (a + b) / 2) & ((a + b) / 2 < high)
    share = np.where(high_x > low_x, inside / np.maximum(high_x - low_x, 1e-12), middle)
    return float((path.volume_ul[writes] * share).sum())


def test_a_region_is_filled_by_its_own_density_and_the_rest_is_not():
    half = Region(box((4, -1, -1), (9, 5, 1)), Filling("lines", 0.5, (0.0,)))
    plain, changed = fresh_toolpath(SOLID, OPTIONS), fresh_toolpath(SOLID, OPTIONS, [half])
    assert ink(changed, 1, 3.5) == pytest.approx(ink(plain, 1, 3.5), rel=0.01)
    # Two walls across 4 mm stay; of the lines between them every other one, to one line.
    walls = 2 * 0.15 / 4
    share = ink(changed, 4.5, 7) / ink(plain, 4.5, 7)
    assert share == pytest.approx(walls + (1 - walls) / 2, abs=0.15 / 4)


def test_outside_the_region_s_height_nothing_changes():
    low = Region(box((-1, -1, -1), (9, 5, 0.06)), Filling("lines", 0.0))
    plain, changed = fresh_toolpath(SOLID, OPTIONS), fresh_toolpath(SOLID, OPTIONS, [low])
    written = [
        [path.volume_ul[(path.source == k) & (path.kind == MoveKind.WRITE)].sum() for k in (0, 1)]
        for path in (plain, changed)
    ]
    assert written[1][0] < 0.2 * written[0][0]
    assert written[1][1] == pytest.approx(written[0][1], rel=1e-9)


def test_an_open_region_is_refused_by_number():
    region = Region(Solid(SOLID.vertices, SOLID.faces[1:]), Filling())
    with pytest.raises(ToolpathError, match=r"region 0 can't be sliced.*closed manifold"):
        fresh_toolpath(SOLID, OPTIONS, [region])
