"""Complete FRESH layers: volume, coverage, heights, order, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from design.errors import ToolpathError
from design.solids.solid import Solid
from design.toolpath import MoveKind
from design.toolpath.fresh import Filling, FreshOptions, check_lumens, plan_fresh
from tests.design.toolpath.plans import fresh_toolpath
from tests.design.toolpath.shapes import (
    as_solid,
    block,
    network,
    planar_block,
    written_area,
)


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


def test_retracted_ink_is_primed_again(plan):
    toolpath = plan.toolpath
    plunger = np.isin(toolpath.kind, (MoveKind.PRIME, MoveKind.RETRACT))
    assert plunger.any()
    assert toolpath.volume_ul[plunger].sum() == pytest.approx(0, abs=1e-12)
    write = toolpath.kind == MoveKind.WRITE
    assert toolpath.written_ul == pytest.approx(toolpath.volume_ul[write].sum(), rel=1e-12)


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


def test_tip_is_at_the_layers_top_while_writing(plan):
    toolpath = plan.toolpath
    write = toolpath.kind == MoveKind.WRITE
    tops = (toolpath.source[write] + 1) * 0.06
    assert toolpath.end[write, 2] == pytest.approx(tops, abs=1e-6)
    assert np.unique(toolpath.source).tolist() == list(range(50))


@pytest.mark.parametrize("layer", [0, 1, 24, 25])
def test_reported_gaps_are_those_of_exact_stadiums(plan, layer):
    material = 128.0 if layer < 10 else None
    written = written_area(plan.toolpath, layer)
    if material is None:
        volume_of_layer = plan.report.unfilled[layer]
        assert volume_of_layer > 0
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


def test_solid_thinner_than_a_line_is_refused():
    with pytest.raises(ToolpathError, match=r"as wide as 0\.4 of a line of 0\.15 mm"):
        fresh_toolpath(as_solid(block(2, 0.05, 0.5)), FreshOptions())


def test_open_mesh_is_refused():
    solid = as_solid(block(2, 2, 1))
    with pytest.raises(ToolpathError, match="closed manifold"):
        fresh_toolpath(Solid(solid.vertices, solid.faces[1:]), FreshOptions())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"layer_height_mm": 0.0}, "layer_height_mm is 0"),
        ({"line_width_mm": float("nan")}, "line_width_mm is nan"),
        ({"walls": 0}, "walls is 0"),
        ({"retract_ul": -1.0}, "retract_ul is -1"),
    ],
)
def test_impossible_options_are_refused(change, message):
    with pytest.raises(ToolpathError, match=message):
        replace(FreshOptions(), **change)


def test_impossible_fillings_are_refused():
    with pytest.raises(ToolpathError, match="infill_angles_deg"):
        Filling(angles_deg=())
    with pytest.raises(ToolpathError, match=r"infill_density is 1\.5"):
        Filling(density=1.5)


def test_lumen_that_lines_would_close_is_refused_by_number():
    nodes = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]
    check_lumens(network(nodes, [(0, 1), (1, 2)], [0.2, 0.075]), FreshOptions())
    with pytest.raises(ToolpathError, match=r"vessel 1: lumen of 0\.100 mm.*0\.150 mm"):
        check_lumens(network(nodes, [(0, 1), (1, 2)], [0.2, 0.05]), FreshOptions())


def test_moves_join_end_to_end(plan):
    assert np.array_equal(plan.toolpath.start[1:], plan.toolpath.end[:-1])
    assert (plan.toolpath.lengths[plan.toolpath.kind == MoveKind.WRITE] > 0).all()
