"""Lumens in FRESH layers: size against exact stadiums, leads, hops, compensation."""

import manifold3d
import numpy as np
import pytest
import shapely
from manifold3d import CrossSection, Manifold

from design.toolpath import MoveKind
from design.toolpath.fresh import Compensation, Filling, FreshOptions
from tests.design.toolpath.plans import fresh_toolpath
from tests.design.toolpath.shapes import (
    along_x,
    as_solid,
    block,
    rounded_width,
    upright,
    written_area,
)
from tests.slower import first_of

FEW_UM = 0.003
HOLES = ((0.8, 0.8, 0.3), (2.0, 1.5, 1.0), (3.3, 0.9, 0.4), (3.2, 2.2, 0.6), (0.7, 2.3, 0.15))


@pytest.fixture(scope="module")
def drilled():
    body = block(4, 3, 0.24)
    for x, y, diameter in HOLES:
        body -= upright(x, y, diameter)
    return as_solid(body)


@pytest.mark.parametrize("walls", [1, 2, 3])
@pytest.mark.parametrize("angle", first_of([37.0, 0.0, 90.0]))
def test_edge_of_upright_lumens_is_the_lines_edge(drilled, walls, angle):
    options = FreshOptions(walls=walls, filling=Filling(angles_deg=(angle,)))
    written = written_area(fresh_toolpath(drilled, options), 0)
    for x, y, diameter in HOLES:
        centre = shapely.Point(x, y)
        assert shapely.distance(centre, written) == pytest.approx(diameter / 2, abs=FEW_UM)
        wider = centre.buffer(diameter / 2 + FEW_UM, quad_segs=64)
        free = shapely.difference(wider, written)
        assert free.area >= np.pi * (diameter / 2 - FEW_UM) ** 2
        assert free.area <= np.pi * (diameter / 2 + FEW_UM) ** 2 * 0.999


@pytest.mark.parametrize("tilt_deg", first_of([75, 30, 15, 45, 60]))
@pytest.mark.parametrize("open_ends", first_of([True, False]))
def test_round_sides_of_lines_hardly_stand_in_a_slanted_lumen(tilt_deg, open_ends):
    """A line is all that is within r of a flat band at mid-layer, r half its height.

    Seven tenths of what would let it touch alone are given: at 75° up to 9 µm stand inside.
    """
    radius, height = 0.3, 0.06
    bar = manifold3d.Manifold.cylinder(12 if open_ends else 6, radius, circular_segments=96)
    bar = bar.translate([0, 0, -6 if open_ends else -3]).rotate([0, tilt_deg, 0])
    body = block(7, 2, 1.2).translate([-3.5, -1, -0.6]) - bar
    path = fresh_toolpath(as_solid(body), FreshOptions())
    axis = np.array([np.sin(np.radians(tilt_deg)), 0, np.cos(np.radians(tilt_deg))])
    move = np.flatnonzero(path.kind == MoveKind.WRITE)
    width = rounded_width(path.volume_ul[move] / path.lengths[move], height)
    nearest = np.inf
    for layer in range(6, 14):
        here = path.source[move] == layer
        ways = np.stack([path.start[move, :2], path.end[move, :2]], axis=1)[here]
        band = shapely.union_all(
            shapely.buffer(shapely.linestrings(ways), (width[here] - height) / 2, quad_segs=32)
        )
        rim = shapely.get_coordinates(shapely.segmentize(shapely.boundary(band), 0.01))
        place = np.column_stack([rim, np.full(len(rim), (layer + 0.5) * height - 0.6)])
        away = np.linalg.norm(np.cross(place, axis), axis=1) - height / 2
        nearest = min(nearest, float(away.min()))
    assert radius - (0.009 if tilt_deg == 75 else 0.005) <= nearest <= radius


def test_level_lumen_is_a_slot_of_the_chord_at_mid_layer():
    diameter, height = 0.4, 0.06
    toolpath = fresh_toolpath(
        as_solid(block(3, 2, 1.2) - along_x(1, 0.6, diameter)), FreshOptions()
    )
    for layer in range(20):
        written = written_area(toolpath, layer)
        off_axis = (layer + 0.5) * height - 0.6
        chord = 2 * np.sqrt(max((diameter / 2) ** 2 - off_axis**2, 0.0))
        across = shapely.LineString([(1.5, 0.6), (1.5, 1.4)])
        open_mm = 0.8 - shapely.intersection(across, written).length
        assert open_mm == pytest.approx(chord, abs=FEW_UM)


ROUND = shapely.union_all([shapely.Point(x, y).buffer(d / 2 - FEW_UM) for x, y, d in HOLES])
SLOT = shapely.box(0, 1.3 + FEW_UM, 4, 1.7 - FEW_UM)


@pytest.mark.parametrize(("slotted", "lumens"), [(False, ROUND), (True, SLOT)])
def test_travels_go_around_round_lumens_and_are_lifted_over_a_slot(drilled, slotted, lumens):
    options = FreshOptions()
    slot = block(4, 0.4, 0.24).translate([0, 1.3, 0])
    body = as_solid(block(4, 3, 0.24) - slot) if slotted else drilled
    toolpath = fresh_toolpath(body, options)
    travel = toolpath.kind == MoveKind.TRAVEL
    ends = np.stack([toolpath.start[travel, :2], toolpath.end[travel, :2]], axis=1)
    crosses = shapely.intersects(shapely.linestrings(ends), lumens)
    height = np.minimum(toolpath.start[travel, 2], toolpath.end[travel, 2])
    layer_top = (toolpath.source[travel] + 1) * options.layer_height_mm
    assert crosses.any() == slotted
    assert (height[crosses] >= layer_top[crosses] + options.lift_mm - 1e-9).all()


def test_seams_of_a_lumen_are_spread_round_it():
    """Twelve layers begin in twelve places, no two nearer than a fifth of their even part."""
    body = block(3, 3, 0.72) - upright(1.5, 1.5, 0.6)
    path = fresh_toolpath(as_solid(body), FreshOptions())
    away = path.end[:, :2] - 1.5
    near = (path.kind == MoveKind.WRITE) & (np.hypot(*away.T) < 0.4)
    angles = []
    for layer in range(12):
        first = np.flatnonzero(near & (path.source == layer))[0]
        x, y = path.start[first, :2] - 1.5
        angles.append(np.arctan2(y, x))
    gaps = np.diff(np.sort(angles), append=np.min(angles) + 2 * np.pi)
    assert gaps.min() > 2 * np.pi / 12 / 5
    assert gaps.max() < 2.5 * 2 * np.pi / 12


# Leads into material, and compensation.


LUMEN_MM = 0.5


def bored(height: float = 0.3, wall: float | None = None) -> Manifold:
    outer = (
        CrossSection.square((6, 6), center=True)
        if wall is None
        else CrossSection.circle(LUMEN_MM + wall, 96)
    )
    return (outer - CrossSection.circle(LUMEN_MM, 96)).extrude(height)


def written(path):
    here = path.kind == MoveKind.WRITE
    width = rounded_width(path.volume_ul[here] / path.lengths[here], path.layer_height_mm)
    lines = np.stack([path.start[here, :2], path.end[here, :2]], axis=1)
    return shapely.linestrings(lines), width


def nearest_ink(path) -> float:
    lines, width = written(path)
    return float((shapely.distance(lines, shapely.Point(0, 0)) - width / 2).min())


def test_the_plunger_primes_and_relieves_away_from_the_lumen():
    path = fresh_toolpath(as_solid(bored()), FreshOptions(lead_mm=0.2))
    standing = np.isin(path.kind, (MoveKind.PRIME, MoveKind.RETRACT))
    away = np.hypot(*path.end[standing, :2].T) - LUMEN_MM
    near = away[away < 0.5]
    assert len(near) >= 8
    # On the lumen's wall 0.2 mm off it; on the second wall, which needs no lead, where that stands.
    assert near.min() > 0.2


def test_a_lead_never_leaves_a_thin_wall():
    path = fresh_toolpath(as_solid(bored(wall=0.16)), FreshOptions(lead_mm=0.3))
    radius = np.hypot(*path.end[path.end[:, 2] < 0.3 + 1e-9, :2].T)
    assert radius.max() < LUMEN_MM + 0.16
    assert radius.min() > LUMEN_MM


def test_what_shrinks_is_written_larger():
    shrunk = Compensation(shrink_percent=(2.0, 1.0, 5.0))
    plain = fresh_toolpath(as_solid(bored(1.2)), FreshOptions())
    larger = fresh_toolpath(as_solid(bored(1.2)), FreshOptions(compensation=shrunk))
    spans = []
    for path in (plain, larger):
        here = path.end[path.kind == MoveKind.WRITE]
        spans.append([*(np.ptp(here[:, :2], axis=0) + 0.15), here[:, 2].max()])
    ratio = np.array(spans[1]) / np.array(spans[0])
    assert ratio[:2] == pytest.approx([1 / 0.98, 1 / 0.99], abs=1e-3)
    assert ratio[2] == pytest.approx(1 / 0.95, abs=0.06 / 1.2)


@pytest.mark.parametrize("radial", [-0.03, 0.04])
def test_what_closes_in_is_written_wider(radial):
    options = FreshOptions(compensation=Compensation(radial_mm=radial))
    path = fresh_toolpath(as_solid(bored()), options)
    assert nearest_ink(path) == pytest.approx(LUMEN_MM + radial, abs=2e-3)
