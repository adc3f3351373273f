"""Zig-zag infill: volume, wall clearance, no turn over a lumen."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from design.toolpath.fresh.contours import Contours
from design.toolpath.fresh.infill import infill_paths
from design.toolpath.fresh.layout import obstacles
from design.toolpath.fresh.order import order_paths
from design.toolpath.fresh.paths import Paths
from design.toolpath.fresh.zigzag import zigzag

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
