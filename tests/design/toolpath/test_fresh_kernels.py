"""FRESH kernels (scan conversion, ordering, coverage), against slow oracles."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from manifold3d import CrossSection

from design.toolpath.fresh.contours import contours_of
from design.toolpath.fresh.infill import Intervals, fill, scan, subtract
from design.toolpath.fresh.layout import lay_out, obstacles
from design.toolpath.fresh.options import FreshOptions
from design.toolpath.fresh.order import order_lines, order_paths
from design.toolpath.fresh.paths import Role, gather, join
from design.toolpath.fresh.report import measure_coverage
from design.toolpath.fresh.walls import build_walls
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


def test_rows_through_vertices_count_them_once():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    found = scan([square], 0.5, 0.0)
    assert found.row.tolist() == [0, 1]
    assert found.low.tolist() == [0, 0]
    assert found.high.tolist() == [1, 1]


def test_empty_region_gives_no_lines():
    assert len(fill([], 0.15, 0.0, np.zeros(2)).width_mm) == 0


sets = st.lists(st.tuples(st.integers(0, 2), st.sets(st.integers(0, 12))), max_size=3)


def as_intervals(cells: set[tuple[int, int]]) -> Intervals:
    """Runs of whole cells as intervals; touching cells are one run."""
    starts = sorted(cell for cell in cells if (cell[0], cell[1] - 1) not in cells)
    ends = sorted(cell for cell in cells if (cell[0], cell[1] + 1) not in cells)
    return Intervals(
        np.array([row for row, _ in starts], dtype=np.int64),
        np.array([float(x) for _, x in starts]),
        np.array([float(x + 1) for _, x in ends]),
    )


@given(first=sets, second=sets)
def test_subtract_is_the_difference_of_sets(first, second):
    one = {(row, x) for row, cells in first for x in cells}
    other = {(row, x) for row, cells in second for x in cells}
    found = subtract(as_intervals(one), as_intervals(other))
    cells = {
        (int(row), x)
        for row, low, high in zip(found.row, found.low, found.high, strict=True)
        for x in range(int(low), int(high))
    }
    assert cells == one - other


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


def test_parallel_lines_are_written_to_and_fro():
    y = np.arange(20) * 0.15
    start, end = np.column_stack([0 * y, y]), np.column_stack([0 * y + 5, y])
    order, flipped = order_lines(start, end, np.zeros(2), 0.2)
    assert order.tolist() == list(range(20))
    assert flipped.tolist() == [False, True] * 10


def test_rings_begin_at_the_point_nearest_the_needle():
    rings = [RING + 10, RING]
    widths = [np.full(len(RING), 0.1)] * 2
    paths = gather(rings, widths, closed=True, role=Role.WALL)
    sequence = order_paths(paths, np.array([3.4, 3.1]), 0.3)
    assert sequence.path.tolist() == [1, 0]
    assert paths.points[sequence.first].tolist() == [RING[2].tolist(), (RING[0] + 10).tolist()]


def test_a_lumens_walls_are_written_from_the_inside_out():
    square = CrossSection.square((12, 6)) - CrossSection.circle(0.5, 48).translate((3, 3))
    section = square - CrossSection.circle(0.5, 48).translate((8, 3))
    paths = build_walls(section, 0.15, 3, 0.4).paths
    sequence = order_paths(paths, np.array([3.9, 3.0]), 0.3)
    for x in (3.0, 8.0):
        first = paths.points[paths.offset[:-1]]
        mine = np.hypot(*(first - [x, 3.0]).T) < 1.0
        levels = [paths.level[k] for k in sequence.path if mine[k]]
        assert levels == [0, 1, 2]


def test_a_backward_path_keeps_each_lines_width():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]])
    paths = gather([points], [np.array([0.0, 0.1, 0.2])], closed=False, role=Role.GAP)
    sequence = order_paths(paths, np.array([3.0, 0.0]), 0.3)
    assert sequence.backward.tolist() == [True]
    far = obstacles(contours_of(CrossSection.square((9, 9)).translate((20, 20))), 0.15)
    tip = np.array([3.0, 0.0, 0.06])
    rows = lay_out(paths, sequence, tip, 0.06, (far, far), FreshOptions())
    assert rows.end[:, 0].tolist() == [1.0, 0.0]
    assert rows.volume_ul == pytest.approx([2 * 0.2 * 0.06, 1 * 0.1 * 0.06])


@settings(max_examples=examples(30), deadline=None)
@given(seed=st.integers(0, 1000))
def test_travels_rise_where_shapely_sees_them_cross_a_contour(seed):
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
    crossed, at = 0, tip[:2]
    for k, first, turned in zip(sequence.path, sequence.first, sequence.backward, strict=True):
        crossed += shapely.LineString([at, paths.points[first]]).intersects(edge)
        at = lines[k][0] if turned else lines[k][-1]
    assert rows.lifted == crossed
    assert rows.travels == 12
    assert (rows.end[:, 2] > 0.06 + options.lift_mm - 1e-9).sum() == 2 * crossed


def test_nothing_to_write_gives_no_moves():
    far = obstacles(contours_of(CrossSection.square((9, 9))), 0.15)
    tip = np.zeros(3)
    sequence = order_paths(join([]), tip[:2], 0.3)
    assert len(lay_out(join([]), sequence, tip, 0.0, (far, far), FreshOptions()).kind) == 0


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
