"""Embedded writing: order, joints, filament law, two heads, bundles of strands, refusals."""

import math
from dataclasses import replace

import numpy as np
import pytest

from design.errors import ToolpathError
from design.network import VesselKind, VesselNetwork
from design.toolpath import MoveKind, Toolpath
from design.toolpath.embedded import (
    EmbeddedHeads,
    EmbeddedOptions,
    bundled,
    check_thinnest,
    plan_embedded,
)
from design.toolpath.embedded.bundles import STRANDS
from design.toolpath.gcode import stream_gcode
from firmware_profiles import Printer, Syringe, load
from tests.design.networks import network, polyline, polylines
from tests.design.toolpath.joint_checker import bodies
from tests.design.toolpath.plans import embedded_toolpath
from tests.design.toolpath.shaft_checker import crossings
from tests.design.toolpath.shapes import random_tree
from tests.slower import first_of

OPTIONS = EmbeddedOptions(overlap_radii=0.5)
PATIENT = replace(OPTIONS, open_joints=99)


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


def test_ink_is_the_networks_volume_and_the_overlaps_and_ends_where_a_vessel_does():
    net = random_tree(30, 12, 5, 0.1)
    report = plan_embedded(net, OPTIONS).report
    design = (np.pi * net.mean_radius() ** 2 * net.lengths()).sum()
    assert report.design_ul == pytest.approx(design, rel=1e-9)
    assert report.written_ul == pytest.approx(report.design_ul + report.overlap_ul, rel=1e-9)
    toolpath = embedded_toolpath(polyline(np.array([[0.0, 0, 0], [10, 0, 0]]), 0.2), OPTIONS)
    assert np.ptp(np.vstack([toolpath.start, toolpath.end]), axis=0).tolist() == [10, 0, 0]


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


def test_vessel_thinner_than_the_needle_or_too_thick_for_the_flow_is_refused_by_number():
    nodes = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]
    net = network(nodes, [(0, 1), (1, 2)], [0.2, 0.05])
    with pytest.raises(ToolpathError, match=r"vessel 1: diameter 0\.100 mm.*0\.128 mm.*0\.16 mm"):
        embedded_toolpath(net, OPTIONS)
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


def refusal(*radii: float) -> str:
    """What is said of upright vessels, one beside the other."""
    nodes = [(k, y, 0) for k in range(len(radii)) for y in (0, 5)]
    net = network(nodes, [(2 * k, 2 * k + 1) for k in range(len(radii))], list(radii))
    with pytest.raises(ToolpathError) as told:
        check_thinnest(net, OPTIONS, needles=SHIPPED)
    return str(told.value)


def test_thinnest_vessels_are_named_with_place_and_a_needle_and_of_hundreds_five() -> None:
    text = refusal(0.2, 0.05, 0.06)
    assert text.startswith("vessel 1: diameter 0.100 mm at (1, 0, 0) mm is thinner than 0.128 mm")
    assert "at most 0.125 mm bore (33g: 0.108 mm)" in text
    assert "1.28 times as large" in text
    # 704 vessels made a line of 11,000 characters (a published network, 2026-11-26).
    text = refusal(*np.linspace(0.06, 0.05, 300))
    assert "300 such vessels: 299 (0.100 mm), 298" in text
    assert "and 295 more" in text
    assert len(text) < 600


# Places to look within passes, before what follows bars the needle's way to a gap.

LOOKED = replace(PATIENT, look_within=True)
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
    plain, looked = (plan_embedded(net, one).toolpath for one in (PATIENT, LOOKED))
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


# Two heads: arteries by one, veins by the other, few changes.


ARTERY, VEIN = VesselKind.ARTERY, VesselKind.VEIN
NODES = np.array([[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0], [0, 6, 0], [4, 6, 0.0]])
ENDS = np.array([[0, 1], [1, 2], [3, 2], [3, 4], [4, 5]])
KIND = np.array([ARTERY, ARTERY, VEIN, ARTERY, VEIN], dtype=np.int64)
NETWORK = VesselNetwork.from_segments(NODES, ENDS, np.full(5, 0.2), KIND, np.zeros(5, np.int64))
FIRST = EmbeddedOptions(overlap_radii=0.5, retract_ul=0.02, plunger_ul_s=0.4)
SECOND = replace(
    FIRST, needle_inner_mm=0.21, needle_outer_mm=0.41, retract_ul=0.05, write_speed_mm_s=3.0
)
HEAD_OF = (KIND == VEIN).astype(np.int64)
HEADS = EmbeddedHeads((FIRST, SECOND), HEAD_OF)


def test_each_vessel_is_written_by_its_own_head_relieved_and_primed_by_itself():
    path = plan_embedded(NETWORK, HEADS).toolpath
    writes = path.kind == MoveKind.WRITE
    np.testing.assert_array_equal(path.tool[writes], HEAD_OF[path.source[writes]])
    assert set(path.speed_mm_s[writes & (path.tool == 1)].tolist()) == {3.0}
    assert set(path.speed_mm_s[writes & (path.tool == 0)].tolist()) == {5.0}
    writes = path.tool[path.kind == MoveKind.WRITE]
    assert int((np.diff(writes) != 0).sum()) == 1
    for row in np.flatnonzero(np.diff(path.tool) != 0).tolist():
        before = path.kind[: row + 1]
        last_write = np.flatnonzero(before == MoveKind.WRITE)[-1]
        assert path.kind[last_write + 1] == MoveKind.RETRACT
        assert path.end[row, 2] > path.end[: row + 1][before == MoveKind.WRITE, 2].max()
    for head, options in enumerate((FIRST, SECOND)):
        own = path.tool == head
        reliefs = path.volume_ul[own & (path.kind == MoveKind.RETRACT)]
        primes = path.volume_ul[own & (path.kind == MoveKind.PRIME)]
        assert set(np.round(reliefs, 9).tolist()) <= {-options.retract_ul}
        assert set(np.round(primes, 9).tolist()) <= {options.retract_ul}
        assert len(reliefs) - len(primes) in (0, 1)


def test_one_head_plans_as_without():
    one = plan_embedded(NETWORK, EmbeddedHeads.one(FIRST, NETWORK)).toolpath
    plain = plan_embedded(NETWORK, FIRST).toolpath
    for name in ("start", "end", "volume_ul", "speed_mm_s", "tool", "kind", "source"):
        np.testing.assert_array_equal(getattr(one, name), getattr(plain, name))


def test_a_vessel_too_thin_for_its_own_needle_or_given_to_no_head_is_refused():
    wide = replace(SECOND, needle_inner_mm=0.6, needle_outer_mm=0.8)
    with pytest.raises(ToolpathError, match="vessel 2"):
        plan_embedded(NETWORK, EmbeddedHeads((FIRST, wide), HEAD_OF))
    plan_embedded(NETWORK, EmbeddedHeads((FIRST, wide), np.zeros(5, dtype=np.int64)))
    with pytest.raises(ToolpathError, match="vessel 2 is given to head 1"):
        EmbeddedHeads((FIRST,), HEAD_OF)


# Thick vessels as strands side by side.


COARSE = EmbeddedOptions(overlap_radii=0.5, needle_inner_mm=0.41, needle_outer_mm=0.72)


def volume(net: VesselNetwork) -> float:
    start, end, a, b, _ = net.pieces()
    length = np.linalg.norm(end - start, axis=1)
    return float((np.pi / 3 * length * (a * a + a * b + b * b)).sum())


def covered(net: VesselNetwork, at: float, radius: float) -> tuple[float, float]:
    """Of a lumen along x: share of its section that strands fill, and their farthest reach."""
    lines = [line for line, _ in net.polylines()]
    places = np.array([[np.interp(at, p[:, 0], p[:, k]) for k in (1, 2)] for p in lines])
    thick = net.radius[net.offset[:-1]]
    side = np.linspace(-radius, radius, 201)
    y, z = np.meshgrid(side, side)
    inside = np.hypot(y, z) < 0.97 * radius
    grid = np.stack([y[inside], z[inside]], axis=1)
    axis = places[0]
    near = np.linalg.norm(grid[:, None] - (places - axis), axis=2) < thick
    return near.any(axis=1).mean(), (np.linalg.norm(places - axis, axis=1) + thick).max() / radius


@pytest.mark.parametrize(("widest", "strands"), [(2.1, 1), (0.8, 7), (0.5, 19), (0.33, 37)])
def test_strands_hold_the_volume_and_fill_the_lumen(widest: float, strands: int) -> None:
    net = polyline(np.array([[0.0, 0, 5], [12, 0, 5]]), 1.0)
    made = bundled(net, np.array([widest]))
    assert len(made.owner) == strands
    assert strands in STRANDS
    assert volume(made.network) == pytest.approx(volume(net), rel=1e-9)
    assert 2 * made.network.radius.max() <= widest * (1 + 1e-9)
    filled, reach = covered(made.network, 6.0, 1.0)
    assert filled > 0.87  # the rest is flats of a hexagon, which the merged ink rounds
    assert reach < 1.05


def test_a_tapered_lumen_keeps_its_volume_and_thin_vessels_are_left_alone() -> None:
    lines = [np.array([[0.0, 0, 5], [12, 0, 5]]), np.array([[12.0, 0, 5], [20, 0, 5]])]
    net = replace(polylines(lines, 1.0), radius=np.array([1.2, 0.6, 0.3, 0.3]))
    made = bundled(net, np.array([0.95, 0.95]))
    assert made.owner.tolist() == [0, 1] + [0] * 6
    assert volume(made.network) == pytest.approx(volume(net), rel=1e-3)
    assert np.array_equal(made.network.vessel_nodes[:2], net.vessel_nodes)


@pytest.mark.parametrize("end", first_of([(0.0, 0.0, 13.0), (12.0, 0.0, 5.0), (3.0, 0.0, 15.0)], 2))
def test_a_lone_bundle_is_written_without_a_crossing(end: tuple[float, float, float]) -> None:
    net = polyline(np.array([[0.0, 0, 5], end]), 1.0)
    plan = plan_embedded(bundled(net, np.array([0.8])), COARSE)
    assert not plan.report.crossings
    assert plan.report.vessels == 1
    written = plan.toolpath.kind == MoveKind.WRITE
    inside = plan.toolpath.volume_ul[written].sum() - plan.report.overlap_ul
    assert inside == pytest.approx(volume(net), rel=1e-6)


def test_the_report_and_the_job_name_the_design_s_vessels() -> None:
    net = random_tree(8, 16.0, 3, 0.2)
    net = replace(net, radius=net.radius * 1.6)
    made = bundled(net, np.full(net.vessel_count, 0.9 * 2 * net.radius.max()))
    assert not made.is_plain
    plan = plan_embedded(made, replace(COARSE, open_joints=99))
    for told in (*plan.report.crossings, *plan.report.grazes):
        assert told.vessel != told.through
        assert max(told.vessel, told.through) < net.vessel_count
    beside: dict[str, np.ndarray] = {}
    job = stream_gcode([plan.toolpath], load(Printer, "generic_marlin"),
                       load(Syringe, "hamilton_1ml"), [80, 80, 40], None, 99.0)  # fmt: skip
    parts = list(made.of_design(job, beside))
    source = np.concatenate([part.line_source for part in parts])
    known = source >= 0
    assert np.array_equal(made.owner[beside["strand"][known]], source[known])
    marks = [line for line in parts[0].data.splitlines() if b"PASS_END" in line]
    assert len(marks) == plan.report.passes
    assert all(int(mark.split(b":")[1]) < net.vessel_count for mark in marks)


def test_more_strands_than_are_laid_are_refused() -> None:
    net = polyline(np.array([[0.0, 0, 5], [12, 0, 5]]), 2.0)
    with pytest.raises(ToolpathError, match=r"vessel 0: diameter 4\.000 mm .* 37 filaments"):
        bundled(net, np.array([0.5]))
