"""Lag compensation of the plunger, against the lag equation integrated in small steps."""

from __future__ import annotations

import numpy as np
import pytest

from design.errors import ToolpathError
from design.toolpath import MoveKind, Toolpath
from design.toolpath.lag import compensate_lag
from design.toolpath.moves import MoveBuilder

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


def test_a_lag_that_is_none_is_refused() -> None:
    with pytest.raises(ToolpathError, match="lag_s"):
        compensate_lag(tapered(0.3, 0.6), 0.0, RATE)
