"""Complete FRESH layers: volume, coverage, adaptive heights, what is too narrow, refusals."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from manifold3d import CrossSection, Manifold

from design.errors import ToolpathError
from design.solids.snap import solid_from_manifold
from design.solids.solid import Solid
from design.toolpath import MoveKind
from design.toolpath.fresh import (
    Adaptive,
    Compensation,
    Filling,
    FreshLayers,
    FreshOptions,
    FreshReport,
    check_lumens,
    plan_fresh,
)
from design.toolpath.fresh.section import adaptive_levels
from tests.design.networks import network
from tests.design.toolpath.plans import fresh_toolpath
from tests.design.toolpath.shapes import along_x, as_solid, block, planar_block, written_area
from tests.slower import examples


@pytest.fixture(scope="module")
def plan():
    return plan_fresh(as_solid(planar_block()), FreshOptions())


def beads(toolpath):
    """Ends, cross-section and layer of each written line; ends to 1 nm."""
    write = toolpath.kind == MoveKind.WRITE
    ends = np.round(np.hstack([toolpath.start[write, :2], toolpath.end[write, :2]]), 6)
    section = toolpath.volume_ul[write] / toolpath.lengths[write]
    return [tuple(row) for row in ends.tolist()], section, toolpath.source[write]


def test_every_line_holds_the_volume_of_its_bead(plan):
    """Walls exactly; infill is up to 5 % wider or narrower, one width a layer, and half of it."""
    whole = (0.15 - 0.06) * 0.06 + np.pi / 4 * 0.06**2
    empty = FreshOptions(filling=Filling(density=0))
    outlines, section, at = beads(fresh_toolpath(as_solid(planar_block()), empty))
    assert section == pytest.approx(whole, rel=1e-9)
    walls = [set() for _ in range(50)]
    for ends, layer in zip(outlines, at.tolist(), strict=True):
        walls[layer].add(ends)
    lines, section, at = beads(plan.toolpath)
    wall = np.array([ends in walls[k] for ends, k in zip(lines, at.tolist(), strict=True)])
    assert wall.sum() > 0.9 * len(outlines)  # a ring's begin may lie elsewhere
    assert section[wall] == pytest.approx(whole, rel=1e-9)
    for layer in range(50):
        infill = section[~wall & (at == layer)]
        fitted = infill.max()
        assert fitted == pytest.approx(whole, rel=0.05)
        near = np.isclose(infill, fitted, rtol=1e-9) | np.isclose(infill, fitted / 2, rtol=1e-9)
        assert near.all()


def test_written_volume_is_the_solids(plan):
    volume = as_solid(planar_block()).volume_mm3
    # Lines' round sides leave notches along the solid's sides, as deep on the mean as `inset_mm`.
    solid = as_solid(planar_block())
    corner = solid.vertices[solid.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) / 2
    sides = np.hypot(normal[:, 0], normal[:, 1]).sum()
    notches = sides * 0.06 * (1 - np.pi / 4) / 2
    assert plan.report.written_ul == pytest.approx(volume - notches, rel=0.005)
    assert plan.report.material_ul == pytest.approx(volume, rel=0.002)


def test_tip_is_at_the_layers_top_retracted_ink_is_primed_again_and_moves_join(plan):
    toolpath = plan.toolpath
    write = toolpath.kind == MoveKind.WRITE
    tops = (toolpath.source[write] + 1) * 0.06
    assert toolpath.end[write, 2] == pytest.approx(tops, abs=1e-6)
    assert np.unique(toolpath.source).tolist() == list(range(50))
    plunger = np.isin(toolpath.kind, (MoveKind.PRIME, MoveKind.RETRACT))
    assert plunger.any()
    assert toolpath.volume_ul[plunger].sum() == pytest.approx(0, abs=1e-12)
    write = toolpath.kind == MoveKind.WRITE
    assert toolpath.written_ul == pytest.approx(toolpath.volume_ul[write].sum(), rel=1e-12)
    assert np.array_equal(plan.toolpath.start[1:], plan.toolpath.end[:-1])
    assert (plan.toolpath.lengths[plan.toolpath.kind == MoveKind.WRITE] > 0).all()


@pytest.mark.parametrize("layer", [0, 1, 24, 25])
def test_reported_gaps_are_those_of_exact_stadiums(plan, layer):
    written, material = written_area(plan.toolpath, layer), 128.0
    if layer > 10:
        assert plan.report.unfilled[layer] > 0
        half = {y: np.sqrt((d / 2) ** 2 - 0.03**2) for y, d in ((1.4, 0.4), (3.2, 0.5))}
        strip = shapely.box(4, 1.4 + half[1.4], 12, 3.2 - half[3.2])
        gap = strip.area - shapely.intersection(written, strip).area
        assert gap < 0.02 * strip.area
    else:
        unfilled = 1 - written.area / material
        # Half a raster point along a strip that is as long as the block.
        raster = 0.5 * 0.015 * 16 / material
        assert plan.report.unfilled[layer] == pytest.approx(unfilled, abs=raster)


def test_most_hops_between_lines_that_arent_joined_are_links():
    report = plan_fresh(as_solid(planar_block()), FreshOptions(joint_mm=0)).report
    assert report.links > 0.9 * report.travels
    assert report.travel_mm < 0.06 * report.written_mm
    assert 0 < report.lifted < 0.05 * report.travels


@pytest.mark.slow
def test_same_input_gives_the_same_moves(plan):
    again = fresh_toolpath(as_solid(planar_block()), FreshOptions())
    assert np.array_equal(again.end, plan.toolpath.end)
    assert np.array_equal(again.volume_ul, plan.toolpath.volume_ul)


def between_two_slots(wall_mm: float):
    slot = block(0.5, 1.5, 1)
    second = slot.translate([1.4 + wall_mm, 0.5, -0.5])
    return as_solid(block(3, 2.5, 0.06) - slot.translate([0.9, 0.5, -0.5]) - second)


def test_a_wall_thinner_than_a_line_is_one_line_as_wide_as_it_is():
    plan = plan_fresh(between_two_slots(0.1), FreshOptions())
    assert plan.report.unfilled[0] < 0.006
    path = plan.toolpath
    thin = path.volume_ul < 0.11 * 0.06 * path.lengths
    here = (path.kind == MoveKind.WRITE) & thin & (np.abs(path.end[:, 0] - 1.45) < 0.01)
    assert path.lengths[here].sum() == pytest.approx(1.5, abs=0.2)


def test_walls_that_leave_less_than_a_wall_between_them_are_filled():
    # 0.42 mm: two outer walls leave 0.12 mm, too little for a second pair.
    report = plan_fresh(as_solid(block(6, 0.42, 0.06)), FreshOptions()).report
    assert report.unfilled[0] < 0.12


def test_solid_thinner_than_a_line_or_open_and_a_lumen_too_thin_are_refused():
    with pytest.raises(ToolpathError, match=r"as wide as 0\.4 of a line of 0\.15 mm"):
        fresh_toolpath(as_solid(block(2, 0.05, 0.5)), FreshOptions())
    solid = as_solid(block(2, 2, 1))
    with pytest.raises(ToolpathError, match="closed manifold"):
        fresh_toolpath(Solid(solid.vertices, solid.faces[1:]), FreshOptions())
    nodes = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]
    check_lumens(network(nodes, [(0, 1), (1, 2)], [0.2, 0.075]), FreshOptions())
    with pytest.raises(ToolpathError, match=r"vessel 1: lumen of 0\.100 mm.*0\.150 mm"):
        check_lumens(network(nodes, [(0, 1), (1, 2)], [0.2, 0.05]), FreshOptions())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"layer_height_mm": 0.0}, "layer_height_mm is 0"),
        ({"line_width_mm": float("nan")}, "line_width_mm is nan"),
        ({"walls": 0}, "walls is 0"),
        ({"retract_ul": -1.0}, "retract_ul is -1"),
        ({"angles_deg": ()}, "infill_angles_deg"),
        ({"density": 1.5}, r"infill_density is 1\.5"),
        ({"shrink_percent": (0.0, 40.0, 0.0)}, "shrink_percent is 40"),
        ({"radial_mm": float("nan")}, "radial_mm is nan"),
    ],
)
def test_impossible_options_are_refused(change, message):
    kinds = (FreshOptions, Filling, Compensation)
    (kind,) = [one for one in kinds if set(change) <= set(one.__dataclass_fields__)]
    with pytest.raises(ToolpathError, match=message):
        kind(**change)


# Adaptive layer heights: stair-step limit, floors met exactly, volume by height.


FINE = Adaptive(0.02, 0.02, 0.0025)
ADAPTIVE = FreshOptions(adaptive=FINE, clear_mm=0.0015, least_move_mm=0.0875)


def wedge(degrees: float) -> Manifold:
    """A block 1 mm high with one side so far off the upright."""
    away = np.tan(np.radians(degrees))
    points = [(0, 0, 0), (3, 0, 0), (0, 2, 0), (3, 2, 0)]
    points += [(0, 0, 1), (3 + away, 0, 1), (0, 2, 1), (3 + away, 2, 1)]
    return Manifold.hull_points(np.array(points, dtype=float))


def foot() -> Manifold:
    """Upright for 0.6 mm, then 50° off the upright for 1 mm."""
    return block(3, 2, 0.6) + wedge(50.0).translate([0, 0, 0.6])


def area_at(z: float) -> float:
    return 2 * (3 + max(z - 0.6, 0.0) * np.tan(np.radians(50.0)))


@pytest.mark.parametrize("degrees", [20.0, 45.0, 60.0])
def test_a_slanted_wall_s_stair_is_no_deeper_than_asked(degrees: float) -> None:
    levels = adaptive_levels([as_solid(wedge(degrees))], 0.06, FINE)
    stair = np.diff(levels) * np.sin(np.radians(degrees))
    assert stair.max() < 0.02 + FINE.step_mm
    assert np.quantile(stair, 0.8) < 0.02 + 1e-6
    # And the layers are no thinner than that asks for, but for the last ones.
    assert np.median(stair) > 0.02 - 0.0026
    assert levels[[0, -1]] == pytest.approx([0.0, 1.0])


def test_a_layer_ends_at_each_floor() -> None:
    body = block(4, 4, 0.5) + block(2, 4, 0.7775)
    levels = adaptive_levels([as_solid(body)], 0.06, FINE)
    assert np.abs(levels - 0.5).min() < 1e-6
    assert levels[-1] == pytest.approx(0.7775)


@settings(max_examples=examples(40), deadline=None)
@given(
    height=st.floats(0.1, 2.0),
    radius=st.floats(0.15, 0.6),
    thinnest=st.sampled_from([0.01, 0.02, 0.03, 0.05]),
    stair=st.floats(0.005, 0.06),
)
def test_heights_stay_within_their_limits_and_fill_the_part(height, radius, thinnest, stair):
    body = block(3, 3, height) - along_x(1.5, height / 2, 2 * radius)
    if body.is_empty():
        return
    solid = as_solid(body)
    levels = adaptive_levels([solid], 0.06, Adaptive(thinnest, stair, 0.0025))
    heights = np.diff(levels)
    assert heights.min() > thinnest - 1e-9
    assert heights.max() < max(0.06, 2 * thinnest) + 1e-9
    assert levels[-1] - levels[0] == pytest.approx(np.ptp(solid.bounds[:, 2]), abs=0.00126)
    assert heights / 0.0025 == pytest.approx(np.rint(heights / 0.0025), abs=1e-6)


def test_each_layer_s_lines_hold_its_own_height() -> None:
    """Volume of a layer: its section's area times its height."""
    found = list(FreshLayers(as_solid(foot()), ADAPTIVE))
    assert len({path.layer_height_mm for path in found}) > 1
    for path in found[1:-1:5]:
        middle = path.end[path.kind == MoveKind.WRITE, 2].max() - path.layer_height_mm / 2
        wrote = path.kind == MoveKind.WRITE
        assert path.volume_ul[wrote].sum() == pytest.approx(
            area_at(middle) * path.layer_height_mm, rel=0.02
        )
        (height,) = path.heights_mm.values()
        assert height == path.layer_height_mm


# Walls and gaps that lines can't make are found, with their width and place.


OPTIONS = FreshOptions()


def report_of(section: CrossSection, options: FreshOptions = OPTIONS) -> FreshReport:
    return plan_fresh(solid_from_manifold(section.extrude(0.3), "part"), options).report


def square(low: tuple[float, float], high: tuple[float, float]) -> CrossSection:
    return CrossSection([[low, (high[0], low[1]), high, (low[0], high[1])]])


BODY = square((0, 0), (6, 4))


@pytest.mark.parametrize("width", [0.02, 0.05, 0.12])
def test_a_slit_is_told_with_its_width_and_place(width: float) -> None:
    found = report_of(BODY - square((2, 1), (2 + width, 3)))
    assert found.thin_walls is None
    assert found.narrow_gaps is not None
    assert found.narrow_gaps.width_mm == pytest.approx(width, rel=0.02)
    assert found.narrow_gaps.least_mm == OPTIONS.line_width_mm
    x, y, z = found.narrow_gaps.at_mm
    assert x == pytest.approx(2 + width / 2, abs=1e-3)
    assert 1 <= y <= 3
    assert 0 < z < 0.3
    assert found.narrow_gaps.layers == 1


def test_a_thin_wall_is_told_and_one_that_gets_a_line_isnt() -> None:
    least = OPTIONS.thinnest_wall_mm
    for width, missing in ((0.05, True), (0.95 * least, True), (1.1 * least, False)):
        found = report_of(BODY + square((6, 1), (9, 1 + width)))
        assert found.narrow_gaps is None
        assert (found.thin_walls is not None) == missing
        if found.thin_walls is not None:
            assert found.thin_walls.width_mm == pytest.approx(width, rel=0.02)
            assert found.thin_walls.least_mm == pytest.approx(least)
            assert f"{width:.3g} mm wide" in found.narrow_notes[0]
            assert f"{least:.3g} mm" in found.narrow_notes[0]


def test_what_gets_no_line_is_what_the_layers_lack() -> None:
    """The least that is named is the slicer's own."""
    for share, filled in ((0.95, False), (1.1, True)):
        width = share * OPTIONS.thinnest_wall_mm
        plan = plan_fresh(
            solid_from_manifold((BODY + square((6, 1), (9, 1 + width))).extrude(0.3), "part"),
            OPTIONS,
        )
        assert (plan.toolpath.end[:, 0].max() > 8) == filled


def chambers(*spans: tuple[float, float]) -> FreshReport:
    """A block of 6 × 4 × 1.2 mm with chambers of 4 × 2 mm between heights."""
    body = Manifold.cube((6, 4, 1.2))
    for low, high in spans:
        body -= Manifold.cube((4, 2, high - low)).translate((1, 1, low))
    return plan_fresh(solid_from_manifold(body, "part"), LEVEL_OPTIONS).report


LEVEL_OPTIONS = FreshOptions(line_width_mm=0.15, layer_height_mm=0.1)


@pytest.mark.parametrize("height", [0.02, 0.05, 0.1, 0.14])
def test_a_membrane_between_layers_is_named_and_counts_as_unfilled(height: float) -> None:
    found = chambers((0.2, 0.6 - height / 2), (0.6 + height / 2, 1))
    assert found.low_gaps is None
    assert found.low_walls is not None
    assert found.low_walls.width_mm == pytest.approx(height, abs=1e-5)
    assert found.low_walls.area_mm2 == pytest.approx(8, rel=0.15)
    assert found.low_walls.at_mm[2] == pytest.approx(0.6, abs=1e-4)
    assert found.low_walls.least_mm == pytest.approx(0.1)
    assert found.part_ul == pytest.approx(28.8 - 8 * (0.8 - height), rel=1e-5)
    if height < 0.1:
        assert found.unfilled_fraction == pytest.approx(8 * height / found.part_ul, abs=0.003)
