"""Lumen kernels (rays, widest circle, connected runs), against slow oracles."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_profiles.bead import BeadSection
from kernels.arrays import FloatArray, IntArray
from printctl.checks.lumens import SectionStations, WrittenLines
from printctl.checks.lumens.stations import slabs_near
from sim.gcode.lumens.leak_kernels import find_runs, join_runs
from sim.gcode.lumens.ray_kernels import first_hit, stadium_span
from sim.gcode.lumens.width_kernels import widest_in_polygon
from tests.slower import examples

coordinate = st.floats(-2, 2, allow_nan=False).map(lambda v: round(v, 4))


def naive_distance(points: FloatArray, line: FloatArray) -> FloatArray:
    """Plan distance of points (n, 2) to a stadium (ends, half width); negative inside."""
    a, b = line[:2], line[2:4]
    way = b - a
    share = np.clip((points - a) @ way / max(float(way @ way), 1e-30), 0, 1)
    found: FloatArray = np.linalg.norm(points - a - share[:, None] * way, axis=1) - line[4]
    return found


def written(line: FloatArray, layer: IntArray, layers: int, mean: FloatArray) -> WrittenLines:
    return WrittenLines(
        line[:, :2].copy(),
        line[:, 2:4].copy(),
        2 * line[:, 4],
        mean,
        layer.astype(np.int64),
        np.linspace(0.0, 0.1 * (layers - 1), layers),
        np.linspace(0.1, 0.1 * layers, layers),
        np.arange(len(line)),
    )


def station(point: FloatArray, reach: float) -> SectionStations:
    one = np.ones(1)
    return SectionStations(
        np.zeros(1, dtype=np.int64),
        point[None],
        np.array([[1.0, 1.0, 1.0]]) / np.sqrt(3),
        one,
        one,
        one * reach,
        one * reach,
        one,
        one > 0,
        ("0",),
    )


@given(*(coordinate for _ in range(8)), st.floats(0.05, 0.6))
def test_a_ray_is_in_a_stadium_where_points_on_it_are(
    px: float, py: float, dx: float, dy: float, x0: float, y0: float, x1: float, y1: float, h: float
) -> None:
    if np.hypot(dx, dy) < 0.01:
        return
    low, high = stadium_span(px, py, dx, dy, x0, y0, x1, y1, h)
    t = np.linspace(-500, 500, 4001)
    t = np.concatenate([t / 100 / np.hypot(dx, dy), t / np.hypot(dx, dy)])
    points = np.array([px, py]) + t[:, None] * [dx, dy]
    away = naive_distance(points, np.array([x0, y0, x1, y1, h]))
    inside = (t >= low) & (t <= high)
    assert (away[inside] < 1e-6).all()
    assert (away[~inside] > -1e-6).all()


@settings(deadline=None, max_examples=examples(60))
@given(st.integers(0, 2**32 - 1), st.sampled_from(["rectangle", "rounded", "ellipse", 15.0]))
def test_a_ray_stops_at_the_first_line_of_any_layer(seed: int, model: Any) -> None:
    """Lines by their own cross-section: as wide at each height as its outline says."""
    rng = np.random.default_rng(seed)
    line = np.column_stack([rng.uniform(-1, 1, (30, 4)), rng.uniform(0.06, 0.1, 30)])
    mean = BeadSection(model).area(2 * line[:, 4], 0.1) / 0.1
    deep = (line[:, 4] - mean / 2) / (1 - np.pi / 4)  # half ellipses that leave this mean
    layer = np.sort(np.append(rng.integers(0, 6, 24), np.arange(6))).astype(np.int64)
    point = np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(0, 0.6)])
    way = rng.normal(size=3) * [1, 1, rng.choice([0.0, 1.0, 9.0])]
    way /= np.linalg.norm(way)
    limit = 1.0
    slabs = slabs_near(written(line, layer, 6, mean), station(point, limit))
    found = first_hit(slabs, point[0], point[1], point[2], way[0], way[1], way[2], limit)
    t = np.linspace(0, limit, 20001)
    at = point + t[:, None] * way
    here = np.floor(at[:, 2] / 0.1)
    away = np.full(len(t), np.inf)
    for k in range(30):
        there = here == layer[k]
        up = at[there][:, 2] / 0.1 - layer[k] - 0.5
        less = deep[k] * (1 - np.sqrt(np.clip(1 - 4 * up**2, 0, 1)))
        away[there] = np.minimum(away[there], naive_distance(at[there][:, :2], line[k]) + less)
    inked = np.flatnonzero(away < 0)
    expected = t[inked[0]] if len(inked) else limit
    assert found <= expected + 1e-4
    # It stops on a line's edge, or where a slab begins, never in the open.
    if found < limit:
        near = np.abs(t - found) < 1e-3
        assert away[near].min() < 1e-3


@settings(deadline=None, max_examples=examples(30))
@given(st.integers(0, 2**32 - 1))
def test_the_widest_circle_is_that_of_a_fine_search(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    away = rng.uniform(0.4, 1.0, 40)
    corner = np.column_stack([away * np.cos(angle), away * np.sin(angle)])
    x, y, radius = widest_in_polygon(corner, 0.0, 0.0, 1.0, 1e-4)
    edges = np.column_stack([np.roll(corner, 1, axis=0), corner, np.zeros(40)])

    def clear(points: FloatArray) -> FloatArray:
        found: FloatArray = np.min([naive_distance(points, edge) for edge in edges], axis=0)
        return found

    grid = np.stack(np.meshgrid(*[np.linspace(-0.35, 0.35, 71)] * 2), axis=-1).reshape(-1, 2)
    inside = np.linalg.norm(grid, axis=1) < 0.3  # of the least corner's chord
    assert radius >= clear(grid[inside]).max() - 1.1e-4
    assert radius == pytest.approx(float(clear(np.array([[x, y]]))[0]), abs=1e-9)


@settings(deadline=None, max_examples=examples(60))
@given(st.integers(0, 2**32 - 1))
def test_runs_join_into_the_spaces_of_a_flood(seed: int) -> None:
    from scipy.ndimage import label

    rng = np.random.default_rng(seed)
    pixels = np.where(rng.random((4, 9, 11)) < 0.45, -1, 0).astype(np.int32)
    group = np.zeros(1, dtype=np.int64)
    runs = [find_runs(layer, group) for layer in pixels]
    first = np.concatenate([[0], np.cumsum([len(r) for r in runs])]).astype(np.int64)
    run = np.concatenate(runs)
    parent = np.arange(len(run))
    used = join_runs(run, first, parent, np.zeros((0, 2), dtype=np.int64))
    assert used == 0
    spaces, count = label(pixels == 0)
    layer = np.searchsorted(first, np.arange(len(run)), side="right") - 1
    of = spaces[layer, run[:, 0], run[:, 1]]
    assert len(np.unique(parent)) == count
    assert len({*zip(parent.tolist(), of.tolist(), strict=True)}) == count


def test_runs_of_different_groups_touch_but_dont_join() -> None:
    pixels = np.array([[0, 1, 1, -1, 2], [0, 0, 2, 2, 2]], dtype=np.int32)
    run = find_runs(pixels, np.array([0, 1]))
    assert run.tolist() == [
        [0, 0, 0, -1], [0, 1, 2, 0], [0, 4, 4, 1], [1, 0, 1, -1], [1, 2, 4, 1],
    ]  # fmt: skip
    touch = np.zeros((9, 2), dtype=np.int64)
    parent = np.arange(5)
    used = join_runs(run, np.array([0, 5]), parent, touch)
    pairs = {tuple(sorted(pair)) for pair in touch[:used].tolist()}
    assert pairs == {(0, 1), (3, 4), (1, 3), (1, 4)}
    assert parent.tolist() == [0, 1, 2, 0, 2]
