"""Zig-zag infill: volume, wall clearance, no turn over a lumen."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from design.toolpath.fresh.contours import Contours
from design.toolpath.fresh.infill import infill_paths, zigzag
from design.toolpath.fresh.layout import obstacles
from design.toolpath.fresh.order import order_paths
from design.toolpath.fresh.paths import Paths

WIDTH = 0.15
LINK = 0.3


def square(low: float, high: float) -> np.ndarray:
    return np.array([[low, low], [high, low], [high, high], [low, high]])


def contours(rings: list[np.ndarray]) -> Contours:
    return Contours(np.concatenate(rings), np.cumsum([0, *map(len, rings)]))


def written(paths: Paths, order: np.ndarray) -> list[np.ndarray]:
    return [paths.points[paths.offset[k] : paths.offset[k + 1]] for k in order]


def volume(paths: Paths, order: np.ndarray) -> float:
    total = 0.0
    for k in order:
        rows = slice(paths.offset[k], paths.offset[k + 1])
        length = np.hypot(*np.diff(paths.points[rows], axis=0).T)
        total += float(length @ paths.width_mm[rows][1:])
    return total


def joined(rings: list[np.ndarray], angle: float, link: float = LINK):
    paths = infill_paths(rings, WIDTH, angle, np.zeros(2), 1.0)
    order = order_paths(paths, np.zeros(2), LINK)
    return paths, order, *zigzag(paths, order, obstacles(contours(rings), WIDTH), link)


def test_a_square_is_filled_in_one_go_with_the_same_volume():
    paths, order, made, sequence = joined([square(0, 3.0)], 0.0)
    assert len(order.path) == 20
    assert len(sequence.path) == 1
    assert volume(made, sequence.path) == pytest.approx(volume(paths, order.path), rel=1e-12)


@pytest.mark.parametrize("angle", [0.0, 20.0, 45.0, 70.0])
def test_joints_run_half_their_width_inside_the_wall(angle):
    rings = [square(0, 3.0)]
    paths, order, made, sequence = joined(rings, angle)
    assert len(sequence.path) < 0.35 * len(order.path)
    assert volume(made, sequence.path) == pytest.approx(volume(paths, order.path), rel=1e-12)
    wall = shapely.Polygon(rings[0]).exterior
    joints = 0
    for line in written(made, sequence.path):
        middle = 0.5 * (line[1:-2:2] + line[2:-1:2])
        joints += len(middle)
        near = shapely.distance(shapely.points(middle), wall)
        width = made.width_mm.max() / 2
        corner = np.abs(middle[:, None] - rings[0][None]).max(axis=2).min(axis=1) < 3 * WIDTH
        assert near[~corner] == pytest.approx(width / 2, abs=0.02 * WIDTH)
    assert joints > 0.6 * len(order.path)


@pytest.mark.parametrize("angle", [0.0, 20.0, 45.0])
def test_joints_leave_hardly_more_uncovered_than_lines_alone(angle):
    """As crests of round-sided beads of 60 µm layers, 13 µm wider than their share."""
    rings = [square(0, 3.0)]
    paths, order, made, sequence = joined(rings, angle)

    def bare(of: Paths, which: np.ndarray) -> float:
        ink = []
        for k in which:
            rows = slice(of.offset[k], of.offset[k + 1])
            way, wide = of.points[rows], of.width_mm[rows][1:] + 0.06 * (1 - np.pi / 4)
            ways = shapely.linestrings(np.stack([way[:-1], way[1:]], axis=1))
            ink.append(shapely.union_all(shapely.buffer(ways, wide / 2)))
        region = shapely.Polygon(rings[0])
        return float(region.difference(shapely.union_all(ink)).area / region.area)

    assert bare(made, sequence.path) < bare(paths, order.path) + 0.004


def test_no_joint_crosses_a_lumen():
    turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)[::-1]
    lumen = 1.5 + 0.03 * np.column_stack([np.cos(turn), np.sin(turn)])
    rings = [square(0, 3.0), lumen]
    _, _, made, sequence = joined(rings, 0.0)
    hole = shapely.Polygon(lumen).buffer(-1e-6)
    for line in written(made, sequence.path):
        assert not shapely.intersects(shapely.linestrings(line), hole)


def test_no_joint_is_longer_than_a_link():
    paths, order, made, sequence = joined([square(0, 3.0)], 0.0, link=0.0)
    assert len(sequence.path) == len(order.path)
    assert volume(made, sequence.path) == volume(paths, order.path)


def test_short_lines_keep_a_middle():
    wedge = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 4.0]])
    paths, order, made, sequence = joined([wedge], 0.0)
    for line in written(made, sequence.path):
        lengths = np.hypot(*np.diff(line, axis=0).T)[::2]
        assert lengths.min() >= 0.5 * 0.5 * WIDTH * 0.95
    assert volume(made, sequence.path) == pytest.approx(volume(paths, order.path), rel=1e-12)


def test_a_whole_line_goes_on_as_a_half_one_with_the_same_volume():
    step = 10.6 * WIDTH
    region = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, step], [2.0, step - 0.6 * WIDTH]])
    region = np.vstack([region, [0.0, step - 0.6 * WIDTH]])
    paths, order, made, sequence = joined([region], 0.0)
    assert np.ptp(paths.width_mm) > 0.4 * WIDTH
    assert len(sequence.path) < len(order.path) / 5
    assert volume(made, sequence.path) == pytest.approx(volume(paths, order.path), rel=1e-12)
