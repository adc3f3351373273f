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
from design.toolpath.fresh.contours import Contours, contours_of, measure_room, sample
from design.toolpath.fresh.paths import Paths, Role, gather
from design.toolpath.fresh.walls import build_walls, clear_of_lumens, gap_paths
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


def test_samples_follow_the_contour_with_normals_into_the_material():
    fine = sample(contours_of(ring(1.0, 2.0)), 0.02)
    radius = np.hypot(*fine.contours.points.T)
    outward = (fine.normal * fine.contours.points).sum(axis=1) / radius
    assert np.where(radius < 1.5, outward, -outward).min() > 0.999
    step = fine.contours.points[fine.contours.next] - fine.contours.points
    assert np.hypot(*step.T).max() <= 0.02 + 1e-12
    assert fine.contours.hole.tolist() == [radius[at] < 1.5 for at in fine.contours.offset[:-1]]


@settings(max_examples=examples(25), deadline=None)
@given(seed=st.integers(0, 10_000))
def test_room_is_the_largest_disc_that_crosses_no_facing_edge(seed):
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 9))
    star = rng.uniform(0.4, 1.0, 9)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    fine = sample(contours_of(CrossSection([star])), 0.07)
    room, other = measure_room(fine, 0.3)
    points, after = fine.contours.points, fine.contours.points[fine.contours.next]
    share = np.linspace(0, 1, 400)[:, None, None]
    along = points + share * (after - points)  # every edge, finely
    way = (after - points) / np.linalg.norm(after - points, axis=1)[:, None]
    facing = np.column_stack([-way[:, 1], way[:, 0]])
    for k in range(0, len(points), 5):
        out = along - points[k]
        ahead = out @ fine.normal[k]
        radius = np.full(ahead.shape, np.inf)
        np.divide((out**2).sum(axis=2), 2 * ahead, out=radius, where=ahead > 1e-9)
        radius[:, facing @ fine.normal[k] > -0.2] = np.inf
        assert room[k] == pytest.approx(min(radius.min(), 0.3), abs=2e-3)
        assert (other[k] >= 0) == (room[k] < 0.3)


@pytest.mark.parametrize("thick", [0.065, 0.1, 0.149, 0.17, 0.21, 0.25, 0.3, 0.36, 0.47, 0.6])
def test_a_tubes_wall_is_filled_once(thick):
    section = ring(0.5, 0.5 + thick)
    walls = build_walls(section, W, 2, 0.4)
    expected = section.area() - walls.inside.area()
    assert volume(walls.paths) == pytest.approx(expected, rel=0.01)
    bare = shape(section - walls.inside).difference(inked(walls.paths)).area
    assert bare < 0.01 * expected


def test_a_lumens_wall_keeps_its_width_before_the_outer_one():
    walls = build_walls(ring(0.5, 0.75), W, 2, 0.4)
    widths = {
        round(float(np.hypot(*a)), 2): round(float(width), 3)
        for a, _, width in strokes(walls.paths)
    }
    assert widths == {0.57: 0.15, 0.58: 0.15, 0.7: 0.1} or widths == {0.58: 0.15, 0.7: 0.1}


def test_two_lumens_share_what_is_between_them():
    gap = 0.22
    hole = CrossSection.circle(0.4, 96)
    section = CrossSection.square((4, 2), center=True)
    section -= hole.translate((-0.4 - gap / 2, 0)) + hole.translate((0.4 + gap / 2, 0))
    walls = build_walls(section, W, 1, 0.4)
    middle = [
        (abs(a[0]), width)
        for a, b, width in strokes(walls.paths)
        if max(abs(a[0]), abs(b[0])) < gap / 2 and max(abs(a[1]), abs(b[1])) < 0.05
    ]
    assert middle
    for away, width in middle:
        assert width == pytest.approx(gap / 2, rel=0.06)
        assert away == pytest.approx(gap / 4, abs=0.01)


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


def test_ink_keeps_clear_of_lumens_alone():
    section = clear_of_lumens(ring(0.5, 1.0), 0.01)
    radius = [np.hypot(*points.T) for points in section.to_polygons()]
    near, far = sorted(radius, key=lambda of: of.max())
    assert near.max() == pytest.approx(0.51, abs=1e-3)
    assert far.max() == pytest.approx(1.0, abs=1e-6)


def test_an_empty_section_has_no_walls():
    walls = build_walls(CrossSection(), W, 2, 0.4)
    assert len(walls.paths) == 0
    assert walls.inside.is_empty()


def test_a_jog_in_a_long_wall_doesnt_tilt_it():
    slot = [(0, 0), (6, 0), (6, 0.8), (0.5, 0.8), (0.44, 0.84), (0, 0.84)]
    section = CrossSection.square((10, 5)).translate((-2, -2)) - CrossSection([slot])
    paths = remove_short_moves(build_walls(section, W, 1, 0.4).paths, 0.0875, W)
    band = shape(section).intersection(shapely.Polygon(slot).buffer(0.05))
    bare = band.difference(inked(paths)).buffer(-0.005)
    assert bare.is_empty


@pytest.mark.parametrize("radius", [0.6, 2.0])
def test_points_left_out_of_a_fine_wall_do_not_add_up(radius):
    """Rounds of leaving out points that each stand off a little once tilted walls by 40 µm."""
    turn = np.linspace(0, 2 * np.pi, int(2 * np.pi * radius / 0.004), endpoint=False)
    ring = radius * np.column_stack([np.cos(turn), 0.7 * np.sin(turn)])
    walls = gather([ring], [np.full(len(ring), W)], closed=True, role=Role.WALL)
    made = remove_short_moves(walls, 0.0875, W)
    wall = shapely.Polygon(made.points)
    assert wall.buffer(0.03 * W + 1e-5).contains(shapely.Polygon(ring))
    assert shapely.distance(shapely.points(ring), wall.exterior).max() < 0.1 * W
    assert len(made.points) < len(ring) / 10


def test_middles_of_thin_places_do_not_turn_back():
    """A lens between two arcs: one line from tip to tip, wherever the ring begins."""
    turn = np.linspace(-0.35, 0.35, 30)
    arc = np.column_stack([np.sin(turn), np.cos(turn) - np.cos(0.35)])
    lens = np.vstack([arc[1:-1] * [1, -1], arc[::-1]])
    for begin in range(0, len(lens), 7):
        ring = np.roll(lens, begin, axis=0)
        found = gap_paths(Contours(ring, np.array([0, len(ring)])), W, 0.4)
        for k in range(len(found)):
            step = np.diff(found.points[found.offset[k] : found.offset[k + 1]], axis=0)
            assert ((step[1:] * step[:-1]).sum(axis=1) > 0).all()
        length = [np.ptp(found.points[a:b, 0]) for a, b in pairwise(found.offset)]
        assert sum(length) > 0.3


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


def test_lines_that_become_one_keep_their_mean_width():
    x = np.linspace(0, 1, 31)
    taper = gather(
        [np.column_stack([x, 0 * x])], [np.linspace(W, W / 2, 31)], closed=False, role=Role.WALL
    )
    made = remove_short_moves(taper, 0.1, W)
    assert len(made.points) < 12
    assert np.linalg.norm(np.diff(made.points[:-1], axis=0), axis=1).min() >= 0.1 - 1e-9
    assert volume(made) == pytest.approx(volume(taper), rel=1e-6)
    assert made.width_mm[-1] < 0.6 * W
