"""Packed layer outlines: unpacked by the page's script as drawn."""

from __future__ import annotations

import numpy as np
import pytest

from registration.report.gcode import DesignOutline
from registration.report.gcode import outline_pack as module
from registration.report.gcode.outline_pack import beyond_um, pack_outlines
from registration.report.gcode.part_outline import REACH_MM
from registration.report.packing import PackedColumn

from .columns import unpacked

RING = np.array([[1.0, 2.0], [1.5, 2.0], [1.5, 2.7], [1.0, 2.0]])
HOLE = np.array([[-0.25, 0.125], [-0.2, 0.15], [-0.25, 0.125]])
OUTLINE = DesignOutline(
    (RING, HOLE), (np.array([0.012, -0.003, 0.0]), np.array([-REACH_MM, 0.0401]))
)
NONE = DesignOutline((), ())


def test_points_rings_and_distances_come_back_in_whole_micrometres() -> None:
    packed = pack_outlines([OUTLINE, NONE])
    assert packed is not None
    assert packed.points == [7, 0]
    rows = unpacked(packed.data[0], 7, [PackedColumn(**one) for one in packed.view["columns"]])
    places, begins, beyond = np.column_stack([rows["x"], rows["y"]]), rows["begins"], rows["beyond"]
    assert places == pytest.approx(np.concatenate([RING, HOLE]))
    assert begins.tolist() == [1, 0, 0, 0, 1, 0, 0]
    assert beyond.tolist() == [0, 12, -3, 0, 0, -300, 40]
    assert packed.beyond_um[1] == []


def test_percentiles_leave_out_pieces_without_ink_near() -> None:
    low, middle, high = beyond_um(OUTLINE)
    assert (middle, high) == pytest.approx((6.0, np.quantile([12, -3, 0, 40.1], 0.95)), abs=0.06)
    assert low > -3.1


def test_too_many_points_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_POINTS", 10)
    assert pack_outlines([OUTLINE]) is not None
    assert pack_outlines([OUTLINE, OUTLINE]) is None
