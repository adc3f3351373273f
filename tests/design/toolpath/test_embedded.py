"""Embedded writing: order, shaft, joints, filament law, refusals."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from design.errors import ToolpathError
from design.network import VesselNetwork
from design.toolpath import MoveKind, Toolpath
from design.toolpath.embedded import EmbeddedOptions, check_thinnest, plan_embedded
from design.toolpath.gcode import stream_gcode
from firmware_profiles import Printer, Syringe, load
from tests.design.toolpath.joint_checker import bodies
from tests.design.toolpath.plans import embedded_toolpath
from tests.design.toolpath.shaft_checker import crossings
from tests.design.toolpath.shapes import network, polyline, random_tree
from tests.slower import first_of

OPTIONS = EmbeddedOptions()


def test_a_helix_is_written_upward_in_one_pass():
    turn = np.linspace(0, 6 * np.pi, 300)
    helix = np.column_stack([3 * np.cos(turn), 3 * np.sin(turn), 0.5 * turn])
    net = polyline(helix[::-1], 0.15)
    plan = plan_embedded(net, OPTIONS)
    assert (plan.report.passes, plan.report.joints, plan.report.crossings) == (1, 0, ())
    assert plan.toolpath.end[-1, 2] > plan.toolpath.start[0, 2]


def test_an_arch_is_written_from_both_feet_and_closed_at_the_top():
    turn = np.linspace(0, np.pi, 60)
    arch = np.column_stack([np.cos(turn), 0 * turn, 3 * np.sin(turn)])
    plan = plan_embedded(polyline(arch, 0.15), OPTIONS)
    assert (plan.report.passes, plan.report.joints, plan.report.overlapped) == (2, 1, 1)
    assert plan.report.crossings == ()
    write = plan.toolpath.kind == MoveKind.WRITE
    rise = (plan.toolpath.end - plan.toolpath.start)[write, 2]
    assert rise.min() > -0.15


def test_an_unavoidable_crossing_is_told():
    def side_by_side(gap: float):
        nodes = [(0, 0, 0), (5, 0, 0), (0, gap, 0), (5, gap, 0)]
        return plan_embedded(network(nodes, [(0, 1), (2, 3)], 0.15), OPTIONS).report

    # The needle's radius and the filament's are 0.305 together; from 5 µm on it is a crossing.
    report = side_by_side(0.298)
    assert len(report.crossings) == 1
    assert report.crossings[0].length_mm == pytest.approx(5, rel=0.05)
    report = side_by_side(0.32)
    assert report.crossings == ()
    assert report.grazes[0].length_mm == pytest.approx(5, rel=0.05)
    assert side_by_side(0.36).grazes == ()


def test_vessels_that_overlap_are_told_as_one_body():
    nodes = [(-2, 0, 0), (2, 0, 0), (0, -2, 0.1), (0, 2, 0.1)]
    net = network(nodes, [(0, 1), (2, 3)], 0.15)
    plan = plan_embedded(net, OPTIONS)
    assert plan.report.crossings == ()
    (merged,) = plan.report.merged
    assert (merged.vessel, merged.other) == (0, 1)
    assert merged.overlap_mm == pytest.approx(0.2, abs=0.02)
    assert crossings(plan.toolpath, net, OPTIONS.needle_outer_mm / 2) == set()


@pytest.mark.parametrize("seed", first_of(range(4)))
def test_an_independent_checker_finds_no_crossing_that_isnt_told(seed):
    net = random_tree(12, 10, seed, 0.1)
    plan = plan_embedded(net, OPTIONS)
    told = {(crossing.vessel, crossing.through) for crossing in plan.report.crossings}
    assert crossings(plan.toolpath, net, OPTIONS.needle_outer_mm / 2) <= told


def test_travels_pass_above_what_lies_under_their_way():
    toolpath = embedded_toolpath(random_tree(20, 10, 3, 0.1), OPTIONS)
    shaft, lowest, ink = OPTIONS.needle_outer_mm / 2, np.inf, np.empty((0, 4))
    for start, end, kind, ul in zip(
        toolpath.start, toolpath.end, toolpath.kind, toolpath.volume_ul, strict=True
    ):
        way = np.linspace(start, end, int(np.linalg.norm(end - start) / 0.05) + 2)
        if kind == MoveKind.TRAVEL and start[2] == end[2]:
            across = np.linalg.norm(ink[:, None, :2] - way[:, :2], axis=2)
            under = (across < shaft + ink[:, 3:]).any(axis=1)
            top = (ink[under, 2] + ink[under, 3]).max(initial=-np.inf)
            assert end[2] >= top + OPTIONS.lift_mm - 1e-9
            lowest = min(lowest, end[2])
        if kind == MoveKind.WRITE:
            radius = np.sqrt(ul / np.linalg.norm(end - start) / np.pi)
            ink = np.vstack([ink, np.column_stack([way, np.full(len(way), radius)])])
    assert lowest < ink[:, 2].max()  # not over the top of all


def test_ink_is_the_networks_volume_and_the_overlaps():
    net = random_tree(30, 12, 5, 0.1)
    report = plan_embedded(net, OPTIONS).report
    design = (np.pi * net.mean_radius() ** 2 * net.lengths()).sum()
    assert report.design_ul == pytest.approx(design, rel=1e-9)
    assert report.written_ul == pytest.approx(report.design_ul + report.overlap_ul, rel=1e-9)


@pytest.mark.parametrize("seed", [1, 2, 5])
def test_every_joint_of_a_tree_is_closed(seed):
    net = random_tree(15, 12, seed, 0.1)
    plan = plan_embedded(net, OPTIONS)
    report = plan.report
    # A tree of n vessels has n - 1 joints, and one for each cut.
    assert report.vessels == net.vessel_count
    cuts = report.passes + report.continued - net.vessel_count
    assert report.joints == net.vessel_count - 1 + cuts
    assert report.overlapped + report.continued == report.joints
    assert len(report.open) == 0
    assert bodies(plan.toolpath) == 1


def test_a_vessel_is_written_from_end_to_end_and_not_beyond():
    toolpath = embedded_toolpath(polyline(np.array([[0.0, 0, 0], [10, 0, 0]]), 0.2), OPTIONS)
    assert np.ptp(np.vstack([toolpath.start, toolpath.end]), axis=0).tolist() == [10, 0, 0]


def test_a_ring_is_closed_by_an_overlap():
    turn = np.linspace(0, 2 * np.pi, 100)
    ring = np.column_stack([4 * np.cos(turn), 4 * np.sin(turn), 0 * turn])
    ring[-1] = ring[0]
    net = polyline(ring, 0.2)
    net = replace(net, nodes=ring[:1], vessel_nodes=np.array([[0, 0]]))
    plan = plan_embedded(net, OPTIONS)
    assert (plan.report.joints, plan.report.overlapped) == (1, 1)
    assert plan.report.overlap_ul == pytest.approx(OPTIONS.overlap_radii * np.pi * 0.2**3)


def test_a_taper_is_written_by_flow_at_constant_speed():
    net = polyline(np.array([[0.0, 0, 0], [10, 0, 0]]), np.array([0.2, 0.1]))
    toolpath = embedded_toolpath(net, OPTIONS)
    x = (toolpath.start[:, 0] + toolpath.end[:, 0]) / 2
    radius = 0.2 - 0.01 * x
    flow = toolpath.volume_ul / (toolpath.lengths / toolpath.speed_mm_s)
    assert toolpath.speed_mm_s == pytest.approx(5.0)
    assert flow == pytest.approx(np.pi * radius**2 * 5.0, rel=0.001)
    assert len(toolpath) > 10


def test_vessel_thinner_than_the_needle_is_refused_by_number():
    nodes = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]
    net = network(nodes, [(0, 1), (1, 2)], [0.2, 0.05])
    with pytest.raises(ToolpathError, match=r"vessel 1: diameter 0\.100 mm.*0\.128 mm.*0\.16 mm"):
        embedded_toolpath(net, OPTIONS)


def test_vessel_too_thick_for_the_flow_is_refused():
    net = polyline(np.array([[0.0, 0, 0], [10, 0, 0]]), 3.0)
    with pytest.raises(ToolpathError, match=r"vessel 0: diameter 6\.000 mm.*max_flow_ul_s"):
        embedded_toolpath(net, OPTIONS)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"needle_inner_mm": 0.5}, "needle_inner_mm 0.5 is above needle_outer_mm 0.31"),
        ({"min_speed_mm_s": 6.0}, "min_speed_mm_s 6 is above write_speed_mm_s 5"),
        ({"clearance_mm": float("inf")}, "clearance_mm is inf"),
    ],
)
def test_impossible_options_are_refused(change, message):
    with pytest.raises(ToolpathError, match=message):
        replace(OPTIONS, **change)


# Refusal of vessels thinner than the needle writes: what it names, and what would help.

SHIPPED = {"30g": 0.16, "33g": 0.108, "34g": 0.08}
OPTIONS_FILAMENT_THICKNESS = EmbeddedOptions(
    needle_inner_mm=0.16, needle_outer_mm=0.31, thinnest=0.8
)


def side_by_side(*radii: float) -> VesselNetwork:
    n = len(radii)
    x = np.arange(n, dtype=float)
    ends = [[k, y, 0.0] for k in x.tolist() for y in (0.0, 5.0)]
    zero = np.zeros(n, np.int64)
    return VesselNetwork.from_segments(
        np.array(ends), np.arange(2 * n).reshape(-1, 2), np.array(radii), zero, zero
    )


def refusal(network: VesselNetwork) -> str:
    with pytest.raises(ToolpathError) as told:
        check_thinnest(network, OPTIONS_FILAMENT_THICKNESS, needles=SHIPPED)
    return str(told.value)


def test_the_thinnest_vessel_is_named_with_its_place_and_a_needle_that_may_be_had() -> None:
    text = refusal(side_by_side(0.2, 0.05, 0.06))
    assert text.startswith("vessel 1: diameter 0.100 mm at (1, 0, 0) mm is thinner than 0.128 mm")
    assert "at most 0.125 mm bore (33g: 0.108 mm)" in text
    assert "1.28 times as large" in text


def test_of_hundreds_the_thinnest_five_are_named() -> None:
    """704 vessels made a line of 11,000 characters (a published network, 2026-11-26)."""
    text = refusal(side_by_side(*np.linspace(0.06, 0.05, 300)))
    assert "300 such vessels: 299 (0.100 mm), 298" in text
    assert "and 295 more" in text
    assert len(text) < 600


# Places to look within passes, before what follows bars the needle's way to a gap.

OPTIONS_EMBEDDED_LOOKS = EmbeddedOptions(open_joints=99)
LOOKED = replace(OPTIONS_EMBEDDED_LOOKS, look_within=True)
RADIUS = 0.15


def leaning(degrees: float, long_mm: float = 6.0) -> Toolpath:
    """A straight vessel that rises so steeply."""
    slope = math.radians(degrees)
    ends = [[0.0, 0, 5], [long_mm * math.cos(slope), 0, 5 + long_mm * math.sin(slope)]]
    return plan_embedded(polyline(np.array(ends), RADIUS), LOOKED).toolpath


def looks(path: Toolpath) -> np.ndarray:
    """Places to look, (n, 3)."""
    return path.end[path.kind == MoveKind.LOOK]


@pytest.mark.parametrize("degrees", [0, 30, 50])
def test_a_gentle_slope_is_looked_at_when_it_is_whole(degrees: float) -> None:
    assert len(looks(leaning(degrees))) == 0


@pytest.mark.parametrize("degrees", [70, 90])
def test_a_steep_one_is_looked_at_before_it_bars_the_way_to_itself(degrees: float) -> None:
    path = leaning(degrees)
    ways = np.linalg.norm(np.diff([path.start[0], *looks(path), path.end[-1]], axis=0), axis=1)
    joint = math.sqrt(2) * (0.155 + RADIUS) + 0.5 * RADIUS
    assert ways.max() <= joint
    assert ways[:-1].min() > joint - 0.25  # whole elements: no more looks than that takes


def test_nothing_is_written_otherwise_for_being_looked_at() -> None:
    net = random_tree(12, 9.0, 3, 0.2)
    plain, looked = (plan_embedded(net, one).toolpath for one in (OPTIONS_EMBEDDED_LOOKS, LOOKED))
    assert 0 < len(looks(looked)) < 60
    assert len(looks(plain)) == 0
    assert looked.written_ul == pytest.approx(plain.written_ul)
    corners = {tuple(row) for row in looked.end[looked.kind == MoveKind.WRITE].round(6).tolist()}
    assert corners >= {tuple(row) for row in plain.end[plain.kind == MoveKind.WRITE].round(6)}
    travels = [path.end[path.kind == MoveKind.TRAVEL] for path in (plain, looked)]
    assert np.allclose(*travels)


def test_each_stands_in_the_job_where_its_part_is_written() -> None:
    path = leaning(70)
    job = stream_gcode([path], load(Printer, "generic_marlin"), load(Syringe, "hamilton_1ml"),
                       [80, 80, 40], None, 99.0)  # fmt: skip
    lines = b"".join(part.data for part in job).decode().splitlines()
    places = [lines[k - 1] for k, line in enumerate(lines) if line == ";PART_END:0"]
    heights = [float(line.split(" Z")[1].split()[0]) - 40 for line in places]
    assert heights == pytest.approx(looks(path)[:, 2], abs=0.001)


def test_moves_join_end_to_end_and_plunger_relief_cancels():
    toolpath = embedded_toolpath(random_tree(20, 10, 3, 0.1), replace(OPTIONS, dwell_s=0.2))
    assert np.array_equal(toolpath.start[1:], toolpath.end[:-1])
    write = toolpath.kind == MoveKind.WRITE
    assert toolpath.written_ul == pytest.approx(toolpath.volume_ul[write].sum(), rel=1e-12)
    assert toolpath.duration_s[toolpath.kind == MoveKind.DWELL] == pytest.approx(0.2)
