"""Purge, wipe and prime line before a part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.errors import ToolpathError
from design.toolpath import MoveBuilder, MoveKind, Toolpath, join_toolpaths
from design.toolpath.priming import (
    HeadPriming,
    PrimeLine,
    Purge,
    Surroundings,
    line_beside_bounds,
    priming,
)

BOUNDS = np.array([[0.0, 0.0, 0.0], [10.0, 6.0, 4.0]])
AROUND = Surroundings(BOUNDS, 20.0, 30.0, 5.0)
LINE = PrimeLine(8.0, 2.0, 0.05, 4.0)
CUP, WIPER = np.array([-30.0, 5.0, 15.0]), np.array([-20.0, 5.0, 15.0])


def part(*, layers: bool = False, tool: int = 0) -> Toolpath:
    builder = MoveBuilder((9.0, 3.0, 1.0), "layer" if layers else "vessel", 0.1 * layers)
    builder.tool = tool
    builder.write(np.array([[2.0, 3.0, 1.0]]), np.array([0.3]), 5.0, 0)
    return builder.build()


def head(**more: object) -> HeadPriming:
    return replace(HeadPriming(0.02, 0.4, line=LINE, dwell_s=0.5), **more)


def test_line_lies_beside_the_nearest_side_and_ends_near_the_first_point():
    start, end = line_beside_bounds(BOUNDS, np.array([9.0, 3.0, 1.0]), LINE)
    assert end == pytest.approx([12.0, 3.0, 1.0])  # 1 mm from the side x = 10
    assert np.linalg.norm(end - start) == pytest.approx(8.0)
    assert start[0] == 12.0
    for x, y, expected in ((0.5, 3, "x=-2"), (5, 0.4, "y=-2"), (5, 5.9, "y=8")):
        start, end = line_beside_bounds(BOUNDS, np.array([x, y, 1.0]), LINE)
        axis, value = "xy".index(expected[0]), float(expected[2:])
        assert start[axis] == end[axis] == value


def test_moves_end_where_the_part_begins_and_leave_nothing_in_it():
    path = part()
    before = priming(path.start[0], 0, [head()], AROUND, path)
    whole = join_toolpaths([before, path])
    assert np.array_equal(whole.start[1:], whole.end[:-1])
    assert np.all(before.source == -1)
    written = before.kind == MoveKind.WRITE
    assert before.volume_ul[written].sum() == pytest.approx(8.0 * 0.05)
    low, high = BOUNDS
    outside = (before.end[written] < low).any(axis=1) | (before.end[written] > high).any(axis=1)
    assert outside.all()
    # Besides the line, what is taken back is given again before the part.
    assert before.volume_ul.sum() == pytest.approx(8.0 * 0.05)
    assert before.kind[-1] == MoveKind.PRIME


def test_needle_crosses_at_the_safe_height_alone():
    path = part()
    purge = Purge(CUP, 5.0, WIPER)
    before = priming(path.start[0], 0, [head(purge=purge)], AROUND, path)
    way = before.end - before.start
    across = (before.kind == MoveKind.TRAVEL) & (np.hypot(way[:, 0], way[:, 1]) > 0)
    wiping = across & (before.end[:, 2] < 20.0)
    assert wiping.sum() == 1
    assert np.array_equal(before.end[wiping][0], WIPER)
    assert np.all(before.start[across & ~wiping, 2] == 20.0)
    assert np.array_equal(before.start[0], CUP)
    kinds = before.kind[before.volume_ul != 0].tolist()
    assert kinds == [MoveKind.PRIME, MoveKind.RETRACT, MoveKind.PRIME, MoveKind.WRITE,
                     MoveKind.RETRACT, MoveKind.PRIME]  # fmt: skip


def test_nothing_to_do_and_a_part_above_the_travels_are_refused():
    path = part()
    with pytest.raises(ToolpathError, match="no head purges or writes"):
        priming(path.start[0], 0, [HeadPriming(0.02, 0.4)], AROUND, path)
    with pytest.raises(ToolpathError, match=r"above the 0\.5 mm"):
        priming(path.start[0], 0, [head()], replace(AROUND, safe_mm=0.5), path)


def test_purge_alone_is_taken_back_once_and_given_again():
    path = part()
    one = HeadPriming(0.02, 0.4, purge=Purge(CUP, 5.0))
    volumes = priming(path.start[0], 0, [one], AROUND, path).volume_ul
    assert volumes[volumes != 0].tolist() == pytest.approx([5.0, -0.02, 0.02])
