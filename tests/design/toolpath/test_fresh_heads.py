"""FRESH layers in several inks: each head stays on its side of a border."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from manifold3d import CrossSection, Manifold

from design.errors import ToolpathError
from design.solids import Solid
from design.toolpath import MoveKind, Toolpath
from design.toolpath.fresh import (
    Compensation,
    Filling,
    FreshLayers,
    FreshOptions,
    Region,
    plan_fresh,
)
from design.toolpath.fresh.infill import gyroid_lines
from tests.design.toolpath.plans import fresh_toolpath
from tests.design.toolpath.shapes import as_solid, block, rounded_width
from tests.slower import examples

HEIGHT = 0.06
OPTIONS = FreshOptions(walls=2, clear_mm=0.0015, least_move_mm=0.0875)
SOLID = as_solid(block(8, 4, 4 * HEIGHT))
LUMEN = (4.0, 2.0, 0.5)


def box(low, high):
    corner = np.array(low, dtype=float)
    return as_solid(block(*(np.array(high) - corner)).translate(corner.tolist()))


def rod(x, y, radius, sides=64):
    return Manifold.cylinder(2.0, radius, radius, sides).translate([x, y, -1.0])


def with_lumen():
    return as_solid(block(8, 4, 4 * HEIGHT) - rod(*LUMEN))


def right(head=1, filling=None):
    return Region(box((4, -1, -1), (9, 5, 1)), filling or Filling(), head)


CREST = HEIGHT * (1 - np.pi / 4) / 2
"""How far a line's round side stands beyond that of the rectangle of its area."""


def planned(solid=SOLID, regions=(), own=OPTIONS, other=OPTIONS):
    return plan_fresh(solid, own, regions, [other])


def ink_of(path: Toolpath, head: int, layer: int | None = None) -> shapely.Geometry:
    """What a head covers, as the union of its lines, each as wide as its ink makes it."""
    rows = (path.kind == MoveKind.WRITE) & (path.tool == head)
    rows &= True if layer is None else path.source == layer
    length = np.linalg.norm(path.end[rows, :2] - path.start[rows, :2], axis=1)
    width = rounded_width(path.volume_ul[rows] / length, path.layer_height_mm)
    ways = np.stack([path.start[rows, :2], path.end[rows, :2]], axis=1)
    return shapely.union_all(shapely.buffer(shapely.linestrings(ways), width / 2))


@pytest.mark.parametrize("percent", [0.0, 3.0])
def test_each_head_writes_the_volume_of_its_region(percent: float) -> None:
    own = replace(OPTIONS, compensation=Compensation((percent, 0.0, 0.0)))
    report = planned(SOLID, [right()], own, own).report
    volume = 4 * 4 * 4 * HEIGHT / (1 - percent / 100)
    assert report.written_ul_of_heads == pytest.approx((volume, volume), rel=0.01)
    assert sum(report.written_ul_of_heads) == pytest.approx(report.written_ul)


@settings(max_examples=examples(15), deadline=None)
@given(
    x=st.floats(2.0, 6.0),
    y=st.floats(1.5, 2.5),
    radius=st.floats(0.7, 1.4),
    least=st.sampled_from([0.0, 0.0875]),
)
def test_neither_ink_lies_in_the_other_s_region_and_both_meet(x, y, radius, least):
    assume(min(y, 4 - y) - radius > 1.5 * OPTIONS.line_width_mm)  # the next test is of the others
    check_border(x, y, radius, least)


def check_border(x: float, y: float, radius: float, least: float) -> None:
    """A disc of a second ink in a block: neither ink in the other's region, no gap between them.

    Rectangles of the lines' area abut at the border; the crests of their round sides pass it.
    """
    own = replace(OPTIONS, least_move_mm=least)
    path = planned(SOLID, [Region(as_solid(rod(x, y, radius)), Filling(), 1)], own, own).toolpath
    angle = np.arange(64) / 64 * 2 * np.pi
    circle = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    disc = shapely.Polygon(np.array([x, y]) + circle)
    outer, inner = ink_of(path, 0, 0), ink_of(path, 1, 0)
    # Of moves long enough for the firmware a point may be left out: 0.03 lines, 4.5 µm.
    # Else the round ends of lines at a facet's corner remain.
    rounding = 5e-3 if least else 1e-4
    past = rounding + CREST
    assert outer.intersection(disc.buffer(-past)).area < 1e-9
    assert inner.difference(disc.buffer(past)).area < 1e-9
    beside = disc.buffer(0.04).difference(disc.buffer(-0.04))
    bare = beside.difference(shapely.union_all([outer, inner])).area
    assert bare / disc.length < rounding


def test_a_straight_border_is_met_from_both_sides_to_rounding() -> None:
    path = planned(SOLID, [right()]).toolpath
    left, over = ink_of(path, 0).bounds, ink_of(path, 1).bounds
    assert left[2] == pytest.approx(4.0 + CREST, abs=1e-6)
    assert over[0] == pytest.approx(4.0 - CREST, abs=1e-6)


def test_a_lumen_on_the_border_keeps_its_size_between_both_inks() -> None:
    one = fresh_toolpath(with_lumen(), OPTIONS)
    two = planned(with_lumen(), [right()]).toolpath
    x, y, radius = LUMEN
    middle = shapely.Point(x, y)
    alone, both = (
        min(middle.distance(ink_of(path, head, 0)) for head in heads)
        for path, heads in ((one, (0,)), (two, (0, 1)))
    )
    assert alone == pytest.approx(radius, abs=3e-3)
    assert both == pytest.approx(alone, abs=3e-3)


def test_a_head_relieves_before_it_is_left_and_primes_when_it_is_back() -> None:
    path = planned(SOLID, [right()]).toolpath
    works = path.kind != MoveKind.TRAVEL
    tool, kind = path.tool[works], path.kind[works]
    changes = np.flatnonzero(np.diff(tool)) + 1
    assert (kind[changes - 1] == MoveKind.RETRACT).all()
    # The second head's first line: nothing was relieved in it before.
    assert kind[changes].tolist() == [MoveKind.WRITE, *[MoveKind.PRIME] * (len(changes) - 1)]
    for head in (0, 1):
        pushed = np.cumsum(path.volume_ul[(path.tool == head) & (path.kind != MoveKind.WRITE)])
        assert pushed.max() < 1e-9
        assert pushed.min() == pytest.approx(-OPTIONS.retract_ul)


@pytest.mark.parametrize(
    ("regions", "heads", "words"),
    [
        ([right(2)], [OPTIONS], "region 0 is written by head 2; options are given for 2"),
        ([right(-1)], [OPTIONS], "region 0 is written by head -1"),
        ([right()], [replace(OPTIONS, layer_height_mm=0.1)], "layer_height_mm is 0.1 for head 1"),
        ([right()], [replace(OPTIONS, clear_mm=0.1)], "clear_mm is 0.1 for head 1"),
    ],
)
def test_heads_that_can_t_share_a_layer_are_refused(regions, heads, words):
    with pytest.raises(ToolpathError, match=words):
        FreshLayers(SOLID, OPTIONS, regions, heads)


# Regions with their own infill: changes only inside the region and inside walls.

OPTIONS_FRESH_REGIONS = FreshOptions(walls=1, filling=Filling(angles_deg=(0.0,)))
SOLID_FRESH_REGIONS = as_solid(block(8, 4, 0.12))


def ink(path, low, high):
    """Ink written between two x, µL; each line shared by its length there."""
    writes = path.kind == MoveKind.WRITE
    a, b = path.start[writes, 0], path.end[writes, 0]
    low_x, high_x = np.minimum(a, b), np.maximum(a, b)
    inside = np.clip(np.minimum(high_x, high) - np.maximum(low_x, low), 0, None)
    middle = (low < (a + b) / 2) & ((a + b) / 2 < high)
    share = np.where(high_x > low_x, inside / np.maximum(high_x - low_x, 1e-12), middle)
    return float((path.volume_ul[writes] * share).sum())


def test_a_region_is_filled_by_its_own_density_and_the_rest_is_not():
    half = Region(box((4, -1, -1), (9, 5, 1)), Filling("lines", 0.5, (0.0,)))
    plain, changed = (
        fresh_toolpath(SOLID_FRESH_REGIONS, OPTIONS_FRESH_REGIONS),
        fresh_toolpath(SOLID_FRESH_REGIONS, OPTIONS_FRESH_REGIONS, [half]),
    )
    assert ink(changed, 1, 3.5) == pytest.approx(ink(plain, 1, 3.5), rel=0.01)
    # Two walls across 4 mm stay; of the lines between them every other one, to one line.
    walls = 2 * 0.15 / 4
    share = ink(changed, 4.5, 7) / ink(plain, 4.5, 7)
    assert share == pytest.approx(walls + (1 - walls) / 2, abs=0.15 / 4)


def test_an_open_region_is_refused_by_number():
    region = Region(Solid(SOLID_FRESH_REGIONS.vertices, SOLID_FRESH_REGIONS.faces[1:]), Filling())
    with pytest.raises(ToolpathError, match=r"region 0 can't be sliced.*closed manifold"):
        fresh_toolpath(SOLID_FRESH_REGIONS, OPTIONS_FRESH_REGIONS, [region])


# Infill patterns: correct surface, requested density, inside the walls.

SIDE_MM = 8.0


def body(height: float = 1.2):
    square = CrossSection.square((SIDE_MM, SIDE_MM))
    return as_solid((square - CrossSection.circle(1.0, 64).translate((4, 4))).extrude(height))


@given(z=st.floats(0, 3))
@settings(max_examples=examples(60), deadline=None)
def test_gyroid_lines_lie_on_the_gyroid_and_none_is_missing(z):
    period = 1.5
    low, high = np.array([-1.0, 0.3]), np.array([2.0, 2.9])
    turn = 2 * np.pi / period

    def height(x, y):
        x, y, up = turn * x, turn * y, turn * z
        return np.sin(x) * np.cos(y) + np.sin(y) * np.cos(up) + np.sin(up) * np.cos(x)

    lines = gyroid_lines(low, high, z, period)
    for line in lines:
        assert np.abs(height(*line.T)).max() < 1e-9
    # Between two places of unlike sign there is a line.
    rng = np.random.default_rng(1)
    from_, to = (low + rng.random((60, 2)) * (high - low) for _ in range(2))
    drawn = shapely.multilinestrings([shapely.linestrings(line) for line in lines])
    here, there = height(*from_.T), height(*to.T)
    unlike = (here * there < 0) & (np.minimum(np.abs(here), np.abs(there)) > 0.1)
    ways = shapely.linestrings(np.stack([from_, to], axis=1)[unlike])
    assert shapely.intersects(drawn, ways).all()


@pytest.mark.parametrize("infill", ["lines", "concentric", "gyroid"])
@pytest.mark.parametrize("density", [0.15, 0.5])
def test_infill_is_as_dense_as_asked(infill, density):
    options = FreshOptions(filling=Filling(infill, density), walls=1)
    plan = plan_fresh(body(), options)
    section = SIDE_MM**2 - np.pi
    # The wall's own ink, and the rest at the density asked for.
    wall = 0.15 * (4 * (SIDE_MM - 0.15) + 2 * np.pi * 1.075)
    expected = (wall + density * (section - wall)) * 1.2
    assert plan.report.written_ul == pytest.approx(expected, rel=0.04)


def test_solid_concentric_infill_leaves_little_bare():
    report = plan_fresh(body(0.06), FreshOptions(filling=Filling("concentric"))).report
    assert report.unfilled_fraction < 0.02
    assert report.written_ul == pytest.approx(report.material_ul, rel=0.02)
