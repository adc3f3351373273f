"""Walls in thin places, gap filling, minimum move length: against slow oracles."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from manifold3d import CrossSection

from design.toolpath.fresh.coarsen import remove_short_moves
from design.toolpath.fresh.paths import Paths, Role
from design.toolpath.fresh.walls import build_walls
from tests.slower import examples

W = 0.15


def ring(inner: float, outer: float, sides: int = 96) -> CrossSection:
    return CrossSection.circle(outer, sides) - CrossSection.circle(inner, sides)


def shape(section: CrossSection) -> shapely.Geometry:
    found = shapely.Polygon()
    for points in section.to_polygons():
        found = found.symmetric_difference(shapely.Polygon(points))
    return found


def strokes(paths: Paths):
    """Each line's two points and width, path by path."""
    for k in range(len(paths)):
        rows = np.arange(paths.offset[k], paths.offset[k + 1])
        if paths.closed[k]:
            rows = np.append(rows, rows[0])
        for a, b in pairwise(rows):
            yield paths.points[a], paths.points[b], paths.width_mm[b]


def volume(paths: Paths) -> float:
    return sum(np.linalg.norm(b - a) * width for a, b, width in strokes(paths))


def inked(paths: Paths) -> shapely.Geometry:
    lines = [
        shapely.LineString([a, b]).buffer(width / 2, quad_segs=16) for a, b, width in strokes(paths)
    ]
    return shapely.union_all(lines)


@settings(max_examples=examples(20), deadline=None)
@given(
    inner=st.floats(0.06, 1.0),
    thick=st.floats(0.07, 0.9),
    least=st.sampled_from([0.0, 0.0875, 0.12]),
    sides=st.integers(12, 80),
)
def test_no_line_comes_nearer_to_a_lumen_than_half_its_width(inner, thick, least, sides):
    section = ring(inner, inner + thick, sides)
    walls = build_walls(section, W, 2, 0.4)
    paths = remove_short_moves(walls.paths, least, W)
    lumen = shapely.Polygon(CrossSection.circle(inner, sides).to_polygons()[0])
    for a, b, width in strokes(paths):
        away = shapely.LineString([a, b]).distance(lumen)
        assert away >= width / 2 - 0.003  # a gap's middle line cuts corners by so much


@settings(max_examples=examples(20), deadline=None)
@given(radius=st.floats(0.1, 0.6), sides=st.integers(16, 64))
def test_moves_round_a_lumen_are_as_long_as_the_firmware_needs(radius, sides):
    walls = build_walls(ring(radius, radius + 1.0, sides), W, 1, 0.4)
    paths = remove_short_moves(walls.paths, 0.0875, W)
    assert (paths.role == Role.WALL).all()
    hole = int(np.argmin([np.hypot(*paths.points[at]) for at in paths.offset[:-1]]))
    points = paths.points[paths.offset[hole] : paths.offset[hole + 1]]
    step = np.abs(np.diff(points, axis=0, append=points[:1])).max(axis=1)
    assert step.min() >= 0.0875 - 1e-9
    assert np.hypot(*points.T).max() < (radius + W / 2) + 0.3 * W + 1e-6


@pytest.mark.parametrize("radius", [0.05, 0.06, 0.075, 0.09])
def test_the_smallest_lumens_stay_round_for_a_fine_needle(radius):
    width = 0.08
    walls = build_walls(ring(radius, radius + 1.0, 24), width, 1, 0.4)
    paths = remove_short_moves(walls.paths, 0.0875, width)
    hole = int(np.argmin([np.hypot(*paths.points[at]) for at in paths.offset[:-1]]))
    points = paths.points[paths.offset[hole] : paths.offset[hole + 1]]
    step = np.abs(np.diff(points, axis=0, append=points[:1])).max(axis=1)
    assert step.min() >= 0.0875 - 1e-9
    inside = shapely.LinearRing(points).distance(shapely.Point(0, 0))
    assert inside == pytest.approx((radius + width / 2) * np.cos(np.pi / 24), abs=2e-3)


@pytest.mark.parametrize("angle_deg", [40, 50, 60, 70])
def test_walls_reach_into_tips_and_stay_inside_them(angle_deg):
    half = np.radians(angle_deg) / 2
    side = 2.0 * np.array([np.cos(half), np.sin(half)])
    material = CrossSection([np.array([[0, 0], side * [1, -1], side])])
    ink = inked(build_walls(material, W, 2, 0.4).paths)
    tip = shape(material).intersection(shapely.box(0, -1, W / 2 / np.sin(half), 1))
    whole = (W / 2) ** 2 * (1 / np.tan(half) - (np.pi / 2 - half))  # beyond a disc as wide as W
    assert tip.difference(ink).area < 0.3 * whole
    beside = shapely.box(-1, -1, 0.7, 1).difference(shape(material))
    assert beside.intersection(ink).area < W**2 / 8
