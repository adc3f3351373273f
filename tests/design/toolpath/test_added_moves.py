"""Moves added to a plan: priming, ways between wells, compensation of lag."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from design.errors import ToolpathError
from design.toolpath import MoveBuilder, MoveKind, Toolpath, join_toolpaths
from design.toolpath.added_moves import (
    HeadPriming,
    PrimeLine,
    Purge,
    Surroundings,
    Trip,
    compensate_lag,
    line_beside_bounds,
    priming,
    with_approach,
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
    one = HeadPriming(0.02, 0.4, purge=Purge(CUP, 5.0))
    volumes = priming(path.start[0], 0, [one], AROUND, path).volume_ul
    assert volumes[volumes != 0].tolist() == pytest.approx([5.0, -0.02, 0.02])


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


def test_nothing_to_do_no_lag_and_a_part_above_the_travels_are_refused():
    path = part()
    with pytest.raises(ToolpathError, match="no head purges or writes"):
        priming(path.start[0], 0, [HeadPriming(0.02, 0.4)], AROUND, path)
    with pytest.raises(ToolpathError, match=r"above the 0\.5 mm"):
        priming(path.start[0], 0, [head()], replace(AROUND, safe_mm=0.5), path)
    with pytest.raises(ToolpathError, match="lag_s"):
        compensate_lag(tapered(0.3, 0.6), 0.0, RATE)


# Compensation of lag, against its equation integrated in small steps.


LAG, RATE = 0.3, 16.0


def tapered(low: float, high: float, moves: int = 40) -> Toolpath:
    """A filament that thickens along 20 mm, with a travel before and after."""
    builder = MoveBuilder([0.0, 0, 5], "vessel")
    builder.travel(np.array([[0.0, 0, 0]]), 5.0, 0)
    x = np.linspace(0, 20, moves + 1)
    edge = np.interp(x, [0, 20], [low, high])
    middle = (edge[1:] + edge[:-1]) / 2
    volume = np.pi / 4 * middle**2 * np.diff(x)
    builder.write(np.column_stack([x[1:], 0 * x[1:], 0 * x[1:]]), volume, 4.0, 0)
    builder.travel(np.array([[20.0, 0, 5]]), 5.0, 0)
    return builder.build()


def flows(path: Toolpath, lag: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, place in x and flow out of the needle, by small explicit steps."""
    length = path.lengths
    lasts = np.where(length > 0, length / np.maximum(path.speed_mm_s, 1e-9), path.duration_s)
    step = 2e-4
    ends = np.cumsum(lasts)
    time = np.arange(0, ends[-1], step)
    row = np.searchsorted(ends, time, side="right").clip(max=len(ends) - 1)
    rate = path.volume_ul / np.maximum(lasts, 1e-12)
    share = (time - (ends - lasts)[row]) / np.maximum(lasts[row], 1e-12)
    place = path.start[row, 0] + share * (path.end - path.start)[row, 0]
    flow, out = 0.0, np.zeros(len(time))
    for k, pushed in enumerate(rate[row]):
        flow += step * (pushed - flow) / lag
        out[k] = flow
    return row, place, out


@pytest.mark.parametrize("ends", [(0.3, 1.0), (1.0, 0.3)])
def test_a_tapered_filament_comes_out_as_designed(ends: tuple[float, float]) -> None:
    plain = tapered(*ends)
    off = []
    for path in (compensate_lag(plain, LAG, RATE).toolpath, plain):
        row, place, flow = flows(path, LAG)
        writes = path.kind[row] == MoveKind.WRITE
        wide = np.sqrt(4 * np.maximum(flow[writes], 0) / (np.pi * 4.0))
        off.append(np.abs(wide / np.interp(place[writes], [0, 20], ends) - 1))
    assert off[0].max() < 0.05
    assert np.mean(off[1] < 0.05) < 0.6


def test_all_that_is_added_is_taken_back_but_for_what_flows_meanwhile() -> None:
    plain = tapered(0.3, 1.0)
    found = compensate_lag(plain, LAG, RATE)
    path = found.toolpath
    assert found.stood_ul == 0.0
    _, _, flow = flows(path, LAG)
    # Nothing is left behind the needle in the end, and what came out is what was pushed.
    assert flow[-1] == pytest.approx(0.0, abs=2e-3)
    assert path.volume_ul.sum() == pytest.approx(flow.sum() * 2e-4, rel=1e-3)
    leak = path.volume_ul.sum() / plain.volume_ul.sum() - 1
    assert 0 <= leak < 0.02


def test_the_path_stays_and_the_plunger_never_goes_back_while_writing() -> None:
    plain = tapered(1.5, 0.3, moves=8)
    found = compensate_lag(plain, 2.0, RATE)
    path = found.toolpath
    writes = path.kind == MoveKind.WRITE
    assert (path.volume_ul[writes] >= 0).all()
    assert path.lengths.sum() == pytest.approx(plain.lengths.sum())
    np.testing.assert_allclose(path.start[1:], path.end[:-1])
    assert (path.source == 0).all()


def test_a_step_of_thickness_is_made_in_place() -> None:
    builder = MoveBuilder([0.0, 0, 0], "vessel")
    builder.write(np.array([[5.0, 0, 0]]), np.array([5 * 0.5]), 4.0, 0)
    builder.write(np.array([[10.0, 0, 0]]), np.array([5 * 0.1]), 4.0, 1)
    path = compensate_lag(builder.build(), LAG, RATE).toolpath
    writes = path.kind == MoveKind.WRITE
    row, _, flow = flows(path, LAG)
    asked = np.where(path.source[row] == 0, 2.0, 0.4)
    assert np.abs(flow / asked - 1)[writes[row]].max() < 0.03
    kinds = path.kind.tolist()
    assert kinds[0] == MoveKind.PRIME
    assert kinds[kinds.index(MoveKind.WRITE) :].count(MoveKind.RETRACT) == 2


# The way from one well to the next.


@pytest.mark.parametrize(("begins", "ends"), [(6.0, 1.0), (1.0, 6.0)])
def test_a_way_below_one_of_its_ends_is_refused(begins: float, ends: float) -> None:
    part: Any = SimpleNamespace(start=np.array([[9.0, 0.0, ends]]))
    with pytest.raises(ToolpathError, match=r"at 5 mm and begins or ends at 6 mm"):
        with_approach(part, np.array([0.0, 0.0, begins]), Trip(5.0, 10.0, 0.1, 1.0))
