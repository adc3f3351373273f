"""FRESH kernels (lines, order, coverage, walls, zig-zags), against slow oracles."""

from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from manifold3d import CrossSection

from design.toolpath.fresh.contours import Contours, contours_of
from design.toolpath.fresh.coverage import measure_coverage
from design.toolpath.fresh.infill import fill, infill_paths, scan, zigzag
from design.toolpath.fresh.layout import lay_out, obstacles
from design.toolpath.fresh.options import FreshOptions
from design.toolpath.fresh.paths import Role, gather, order_lines, order_paths
from design.toolpath.fresh.walls import build_walls, remove_short_moves
from design.toolpath.toolpath import MoveKind
from tests.slower import examples

RING = np.array([[0.0, 0.0], [4.0, 0.3], [3.5, 3.0], [0.4, 2.6]])


HOLE = np.array([[1.0, 1.0], [1.2, 2.0], [2.0, 1.9], [2.1, 0.9]])


SHAPE = shapely.Polygon(RING, [HOLE])


def test_scan_finds_what_shapely_finds():
    found = scan([RING, HOLE], 0.1, 0.05)
    for row in range(-2, 35):
        y = 0.05 + 0.1 * row
        exact = shapely.intersection(SHAPE, shapely.LineString([(-1, y), (9, y)])).length
        here = found.row == row
        assert (found.high - found.low)[here].sum() == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize("angle", [0.0, 90.0, 180.0, 30.0, -45.0])
def test_fill_writes_the_regions_volume_with_lines_inside(angle):
    lines = fill([RING, HOLE], 0.05, angle, np.array([0.1, 0.2]))
    length = np.linalg.norm(lines.end - lines.start, axis=1)
    assert (length * lines.width_mm).sum() == pytest.approx(SHAPE.area, rel=0.01)
    drawn = shapely.linestrings(np.stack([lines.start, lines.end], axis=1))
    assert shapely.covers(SHAPE.buffer(1e-6), drawn).all()
    way = (lines.end - lines.start) / length[:, None]
    turned = [np.cos(np.radians(angle)), np.sin(np.radians(angle))]
    assert np.abs(way @ turned) == pytest.approx(1.0)


def travel(start, end, order, flipped, at):
    total = 0.0
    for line in order:
        begin, finish = (end, start) if flipped[line] else (start, end)
        total += np.linalg.norm(begin[line] - at)
        at = finish[line]
    return total


def nearest_neighbour(start, end, at):
    left, order, flipped = set(range(len(start))), [], np.zeros(len(start), bool)
    while left:
        _, line, turn = min(
            (np.linalg.norm(ends[k] - at), k, turn)
            for k in left
            for turn, ends in ((False, start), (True, end))
        )
        order.append(line)
        flipped[line] = turn
        left.remove(line)
        at = start[line] if turn else end[line]
    return order, flipped


@settings(max_examples=examples(30), deadline=None)
@given(count=st.integers(0, 30), seed=st.integers(0, 1000), link=st.sampled_from([0.0, 0.2]))
def test_order_is_complete_and_no_longer_than_nearest_neighbour(count, seed, link):
    rng = np.random.default_rng(seed)
    start, end, at = rng.random((count, 2)), rng.random((count, 2)), rng.random(2)
    order, flipped = order_lines(start, end, at, link)
    assert sorted(order) == list(range(count))
    naive = travel(start, end, *nearest_neighbour(start, end, at), at)
    assert travel(start, end, order, flipped, at) <= naive + 1e-9


def travels_of(lines, sequence, at):
    """Straight ways from each line's end to the next one's begin."""
    for k, turned in zip(sequence.path, sequence.backward, strict=True):
        first, last = lines[k][::-1] if turned else lines[k]
        yield at, first
        at = last


@settings(max_examples=examples(30), deadline=None)
@given(seed=st.integers(0, 1000))
def test_travels_rise_or_go_around_where_shapely_sees_them_cross_a_contour(seed):
    rng = np.random.default_rng(seed)
    section = CrossSection([RING]) - CrossSection([HOLE[::-1]])
    spots = rng.uniform(0.2, 3.4, (12, 2))
    lines = [np.stack([spot, spot + 0.01]) for spot in spots]
    paths = gather(lines, [np.full(2, 0.01)] * 12, closed=False, role=Role.GAP)
    here = obstacles(contours_of(section), 0.15)
    tip = np.array([0.5, 0.5, 0.06])
    sequence = order_paths(paths, tip[:2], 0.0)
    options = FreshOptions(link_mm=0.0)
    rows = lay_out(paths, sequence, tip, 0.06, (here, here), options)
    edge = SHAPE.boundary
    crossed = sum(
        shapely.LineString(ends).intersects(edge) for ends in travels_of(lines, sequence, tip[:2])
    )
    assert rows.lifted <= crossed
    assert rows.travels == 12
    assert (rows.end[:, 2] > 0.06 + options.lift_mm - 1e-9).sum() == 2 * rows.lifted
    ends = np.vstack([rows.start, rows.end])
    level = (ends[1:, 2] == ends[:-1, 2]) & (rows.kind == MoveKind.TRAVEL)
    crosses = shapely.intersects(
        shapely.linestrings(np.stack([ends[:-1, :2], ends[1:, :2]], axis=1)[level]), edge
    )
    assert (ends[1:, 2][level] > 0.06 + options.lift_mm - 1e-9).tolist() == crosses.tolist()
    going = np.hypot(*np.diff(ends[:, :2], axis=0)[level & (ends[1:, 2] > 0.06)].T).sum()
    straight = sum(np.linalg.norm(a - b) for a, b in travels_of(lines, sequence, tip[:2]))
    saved = 2 * (options.lift_mm - options.hop_mm) * (crossed - rows.lifted)
    limit = saved * options.travel_speed_mm_s / options.lift_speed_mm_s
    assert going <= straight + limit + 1e-9


@settings(max_examples=examples(20), deadline=None)
@given(seed=st.integers(0, 1000), count=st.integers(1, 8))
def test_coverage_is_the_area_of_stadiums(seed, count):
    rng = np.random.default_rng(seed)
    start, end = rng.uniform(-0.5, 4.5, (2, count, 2))
    end[0] = start[0]  # a dot
    width = rng.uniform(0.2, 0.6, count)
    lines = shapely.linestrings(np.stack([start, end], axis=1))
    written = shapely.union_all(shapely.buffer(lines, width / 2, quad_segs=32))
    found = measure_coverage([RING, HOLE], start, end, width, 0.01)
    assert found.material == pytest.approx(SHAPE.area, abs=0.02)
    unfilled = shapely.difference(SHAPE, written).area
    assert found.unfilled == pytest.approx(unfilled, abs=0.05)
    outside = shapely.difference(written, SHAPE).area
    assert found.outside == pytest.approx(outside, abs=0.05)


W = 0.15


def strokes(paths, which=None):
    """Each line's two points and width, path by path."""
    for k in range(paths.number) if which is None else which:
        rows = np.arange(paths.offset[k], paths.offset[k + 1])
        for a, b in pairwise(np.append(rows, rows[0]) if paths.closed[k] else rows):
            yield paths.points[a], paths.points[b], paths.width_mm[b]


def volume(paths, which=None):
    return sum(np.linalg.norm(b - a) * width for a, b, width in strokes(paths, which))


def inked(paths):
    lines = [shapely.LineString([a, b]).buffer(w / 2, quad_segs=16) for a, b, w in strokes(paths)]
    return shapely.union_all(lines)


def shape(section):
    found = shapely.Polygon()
    for points in section.to_polygons():
        found = found.symmetric_difference(shapely.Polygon(points))
    return found


def tube(inner, outer, sides=96):
    return CrossSection.circle(outer, sides) - CrossSection.circle(inner, sides)


@pytest.mark.parametrize("thick", [0.065, 0.1, 0.149, 0.17, 0.21, 0.25, 0.3, 0.36, 0.47, 0.6])
def test_a_tubes_wall_is_filled_once(thick):
    section = tube(0.5, 0.5 + thick)
    walls = build_walls(section, W, 2, 0.4)
    expected = section.area() - walls.inside.area()
    assert volume(walls.paths) == pytest.approx(expected, rel=0.01)
    bare = shape(section - walls.inside).difference(inked(walls.paths)).area
    assert bare < 0.01 * expected


@settings(max_examples=examples(20), deadline=None)
@given(
    inner=st.floats(0.06, 1.0),
    thick=st.floats(0.07, 0.9),
    least=st.sampled_from([0.0, 0.0875, 0.12]),
    sides=st.integers(12, 80),
)
def test_no_line_comes_nearer_to_a_lumen_than_half_its_width(inner, thick, least, sides):
    walls = build_walls(tube(inner, inner + thick, sides), W, 2, 0.4)
    lumen = shapely.Polygon(CrossSection.circle(inner, sides).to_polygons()[0])
    for a, b, width in strokes(remove_short_moves(walls.paths, least, W)):
        away = shapely.LineString([a, b]).distance(lumen)
        assert away >= width / 2 - 0.003  # a gap's middle line cuts corners by so much


def test_short_moves_become_one_without_loss_of_volume_or_place():
    x = np.linspace(0, 1, 31)
    line = np.column_stack([x, 0 * x])
    taper = gather([line], [np.linspace(W, W / 2, 31)], closed=False, role=Role.WALL)
    made = remove_short_moves(taper, 0.1, W)
    assert np.linalg.norm(np.diff(made.points[:-1], axis=0), axis=1).min() >= 0.1 - 1e-9
    assert volume(made) == pytest.approx(volume(taper), rel=1e-6)
    # Rounds of leaving out points that each stand off a little once tilted walls by 40 µm.
    turn = np.linspace(0, 2 * np.pi, 3000, endpoint=False)
    ring = 2.0 * np.column_stack([np.cos(turn), 0.7 * np.sin(turn)])
    walls = gather([ring], [np.full(len(ring), W)], closed=True, role=Role.WALL)
    wall = shapely.Polygon(remove_short_moves(walls, 0.0875, W).points)
    assert wall.buffer(0.03 * W + 1e-5).contains(shapely.Polygon(ring))
    assert shapely.distance(shapely.points(ring), wall.exterior).max() < 0.1 * W


SQUARE = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [0.0, 3.0]])


def joined(rings, angle):
    """Lines of a filling, their order, and the same joined to zig-zags."""
    paths = infill_paths(rings, W, angle, np.zeros(2), 1.0)
    order = order_paths(paths, np.zeros(2), 0.3)
    edges = Contours(np.concatenate(rings), np.cumsum([0, *map(len, rings)]))
    return paths, order, *zigzag(paths, order, obstacles(edges, W), 0.3)


@pytest.mark.parametrize("angle", [0.0, 20.0, 45.0, 70.0])
def test_zigzags_keep_the_volume_and_run_half_their_width_inside_the_wall(angle):
    paths, order, made, sequence = joined([SQUARE], angle)
    assert len(sequence.path) < 0.35 * len(order.path)
    assert volume(made, sequence.path) == pytest.approx(volume(paths), rel=1e-12)
    wall, joints = shapely.Polygon(SQUARE).exterior, 0
    for k in sequence.path:
        line = made.points[made.offset[k] : made.offset[k + 1]]
        middle = 0.5 * (line[1:-2:2] + line[2:-1:2])
        joints += len(middle)
        near = shapely.distance(shapely.points(middle), wall)
        corner = np.abs(middle[:, None] - SQUARE[None]).max(axis=2).min(axis=1) < 3 * W
        assert near[~corner] == pytest.approx(made.width_mm.max() / 4, abs=0.02 * W)
    assert joints > 0.6 * len(order.path)


def test_no_joint_of_a_zigzag_crosses_a_lumen():
    turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)[::-1]
    lumen = 1.5 + 0.03 * np.column_stack([np.cos(turn), np.sin(turn)])
    _, _, made, sequence = joined([SQUARE, lumen], 0.0)
    hole = shapely.Polygon(lumen).buffer(-1e-6)
    for a, b, _ in strokes(made, sequence.path):
        assert not shapely.intersects(shapely.LineString([a, b]), hole)
