"""Embedded plans judged by independent checkers: shapes, travels, vessels left out, old wakes."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.errors import ToolpathError
from design.toolpath import MoveKind, Toolpath
from design.toolpath.embedded import (
    EmbeddedHeads,
    EmbeddedOptions,
    plan_embedded,
)
from design.toolpath.embedded.left_out import Supply
from design.toolpath.embedded.order.pass_order import SearchLimits
from design.toolpath.embedded.write import ground_under, highest_along, lay
from tests.design.networks import network, polyline, polylines
from tests.design.toolpath.joint_checker import bodies
from tests.design.toolpath.plans import embedded_toolpath
from tests.design.toolpath.random_networks import random_network
from tests.design.toolpath.shaft_checker import crossings
from tests.design.toolpath.shapes import cage, helix, random_tree, ring
from tests.slower import examples, first_of

OPTIONS = EmbeddedOptions(overlap_radii=0.5)
ARCH = np.linspace(0, np.pi, 60)
KNOT = np.linspace(0, 2 * np.pi, 120)
STACK_NODES = [(x, 0, z) for z in (3, 1, 4, 0, 2) for x in (0, 5)]
STACK = network(STACK_NODES, [(2 * k, 2 * k + 1) for k in range(5)], 0.2)
UNDER = network([(-3, 0, 0), (3, 0, 0), (-3, 0, 2), (3, 0, 2)], [(0, 1), (2, 3)], 0.15)
CORNERS = [(0, 0, 0), (3, 0, 0), (3, 0, 3), (0, 0, 3)]
SQUARE = network(CORNERS, [(0, 1), (1, 2), (2, 3), (3, 0)], 0.15)
# Three bars, each lying on the next: A over B, B over C, C over A.
LEANING = network(
    [(0, 0, 0), (6, 0, 3), (5.5, -1, 0), (0, 6, 3), (0.3, 6, 0), (0.2, -0.2, 3)],
    [(0, 1), (2, 3), (4, 5)],
    0.15,
)


def trefoil() -> np.ndarray:
    x, y = np.sin(KNOT) + 2 * np.sin(2 * KNOT), np.cos(KNOT) - 2 * np.cos(2 * KNOT)
    line = 1.2 * np.column_stack([x, y, -np.sin(3 * KNOT)])
    line[-1] = line[0]
    return line


SHAPES = {
    "a vertical stack": (STACK, 5),
    "a vessel straight under another": (UNDER, 2),
    "a helix": (polyline(helix(3, 3.0, 3.0), 0.15), 1),
    "a helix told downward": (polyline(helix(3, 3.0, 3.0)[::-1], 0.15), 1),
    "two interleaved helices": (
        polylines([helix(3, 3.0, 3.0), helix(3, 3.0, 3.0, np.pi)], 0.15),
        2,
    ),
    "a cage": (cage(8, 3.0, 4.0), 1),
    "an arch": (
        polyline(np.column_stack([np.cos(ARCH), 0 * ARCH, 3 * np.sin(ARCH)]), 0.15),
        1,
    ),
    "a flat ring": (polylines([ring(3.0, 0.0)], 0.15), 1),
    "a ring on its edge": (polylines([ring(2.0, np.pi / 2)], 0.15), 1),
    "a square on its edge": (SQUARE, 1),
    "a trefoil knot": (polylines([trefoil()], 0.15), 1),
    "three bars that lean on each other": (LEANING, 3),
}


@pytest.mark.parametrize("name", first_of(SHAPES, 4))
def test_a_shape_is_written_without_a_crossing_and_holds_together(name):
    net, expected = SHAPES[name]
    plan = plan_embedded(net, OPTIONS)
    report = plan.report
    assert (report.crossings, report.merged, len(report.open)) == ((), (), 0)
    assert report.joints == report.overlapped + report.continued
    assert crossings(plan.toolpath, net, OPTIONS.needle_outer_mm / 2) == set()
    assert bodies(plan.toolpath) == expected


@pytest.mark.parametrize(
    ("name", "passes"),
    [
        ("a vertical stack", 5),
        ("a helix", 1),
        ("a helix told downward", 1),
        ("a flat ring", 1),
        ("an arch", 2),
        ("a square on its edge", 2),
    ],
)
def test_a_shape_is_written_in_as_few_passes_as_can_be(name, passes):
    assert plan_embedded(SHAPES[name][0], OPTIONS).report.passes == passes


def test_the_checker_flags_a_planted_crossing():
    """The same moves for a network upside down: what was below lies above."""
    net = SHAPES["a vertical stack"][0]
    path = plan_embedded(net, OPTIONS).toolpath
    flip = np.array([1.0, 1.0, -1.0])
    fallen = replace(path, start=path.start * flip, end=path.end * flip)
    upset = replace(net, nodes=net.nodes * flip, points=net.points * flip)
    assert len(crossings(fallen, upset, OPTIONS.needle_outer_mm / 2)) >= 4


def test_the_checker_of_joints_finds_a_missing_overlap():
    net = random_tree(8, 10, 2, 0.1)
    plain = plan_embedded(net, replace(OPTIONS, overlap_radii=0.0)).toolpath
    assert bodies(plan_embedded(net, OPTIONS).toolpath) == 1
    assert bodies(plain) > 1


@pytest.mark.slow
@settings(max_examples=examples(12), deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10_000),
    terminals=st.integers(2, 24),
    size_mm=st.floats(7, 14),
    overlap=st.sampled_from([0.5, 1.0]),
)
def test_any_plan_of_a_tree_passes_the_checkers_unless_its_report_says_where(
    seed, terminals, size_mm, overlap
):
    net = random_tree(terminals, size_mm, seed, 0.1)
    plan = plan_embedded(net, replace(OPTIONS, overlap_radii=overlap, open_joints=terminals))
    told = {(crossing.vessel, crossing.through) for crossing in plan.report.crossings}
    for pair in plan.report.merged:  # the tree's own collisions
        told |= {(pair.vessel, pair.other), (pair.other, pair.vessel)}
    assert crossings(plan.toolpath, net, OPTIONS.needle_outer_mm / 2) <= told
    assert bodies(plan.toolpath) <= 1 + len(plan.report.open)


def funnel(overlap_radii: float):
    """Three vessels come down to a node; a ring under all bars the way beyond it."""
    turn = 2 * np.pi * np.arange(3) / 3
    arms = [np.array([[3 * np.cos(t), 3 * np.sin(t), 3.0], [0, 0, 0]]) for t in turn]
    below = ring(0.7, 0.0) + np.array([0, 0, -0.3])
    return polylines([*arms, below], 0.15), replace(OPTIONS, overlap_radii=overlap_radii)


def test_a_joint_that_stays_open_is_refused_by_place(monkeypatch):
    net, options = funnel(4.0)
    monkeypatch.setattr("design.toolpath.embedded.order.pass_order.LIMITS", SearchLimits(rounds=1))
    monkeypatch.setattr("design.toolpath.embedded.order.joints.PARTS", (1.0,))
    with pytest.raises(ToolpathError, match=r"1 of 3 joints .*vessel \d with vessel \d at \(0\.00"):
        plan_embedded(net, options)
    allowed = plan_embedded(net, replace(options, open_joints=1))
    assert (allowed.report.joints, len(allowed.report.open)) == (3, 1)


@pytest.mark.parametrize("radius", [0.2, 0.7])
def test_a_steep_vessel_is_written_upward_however_thick(radius):
    """A thick one reaches further ahead than its joint does: that is no collision with itself."""
    net = polylines([np.array([[0.0, 0, 6], [2, 0, 3], [4, 0, 0]])], radius)
    path = plan_embedded(net, replace(OPTIONS, overlap_radii=0.2, max_flow_ul_s=8.0)).toolpath
    write = path.kind == MoveKind.WRITE
    assert ((path.end - path.start)[write, 2] > 0).all()


# Travels: above obstacles, as low as possible, slow near ink.


WIDE = replace(OPTIONS, needle_outer_mm=0.7, lift_mm=0.5)


def way_sampled(start, end, step=0.02):
    count = int(np.ceil(np.linalg.norm(end - start) / step)) + 1
    return np.linspace(start, end, count + 1)


def tops_under(ink, radius, way, shaft_mm):
    """Tops of the ink that a needle on a way comes upon, -inf for none."""
    gap = np.hypot(*(ink[:, None, :2] - way[None, :, :2]).transpose(2, 0, 1)).min(axis=1)
    under = gap < shaft_mm + radius
    return (ink[:, 2] + radius)[under].max(initial=-np.inf)


def written_before(toolpath, move):
    """Ink (n, 3), its radius and the top of its move, of all moves before one."""
    found = []
    for k in np.flatnonzero(toolpath.kind[:move] == MoveKind.WRITE):
        a, b = toolpath.start[k], toolpath.end[k]
        points = way_sampled(a, b, 0.05)
        radius = np.sqrt(toolpath.volume_ul[k] / np.linalg.norm(b - a) / np.pi)
        told = np.broadcast_to([radius, max(a[2], b[2])], (len(points), 2))
        found.append(np.hstack([points, told]))
    ink = np.concatenate(found) if found else np.empty((0, 5))
    return ink[:, :3], ink[:, 3], ink[:, 4]


PATHS = {
    "tree": (random_tree(20, 10, 3, 0.1), OPTIONS),
    "cage": (cage(8, 3.0, 4.0), OPTIONS),
    "wide needle": (random_tree(10, 12, 1, 0.2), WIDE),
}


@pytest.mark.parametrize("name", PATHS)
def test_travels_pass_above_what_lies_under_their_way_by_the_lift(name):
    net, options = PATHS[name]
    toolpath = plan_embedded(net, replace(options, open_joints=9)).toolpath
    across = 0
    for move in np.flatnonzero(toolpath.kind == MoveKind.TRAVEL).tolist():
        start, end = toolpath.start[move], toolpath.end[move]
        if np.array_equal(start[:2], end[:2]):
            continue
        across += 1
        assert start[2] == end[2]  # no diagonal through the print
        ink, radius, high = written_before(toolpath, move)
        way = way_sampled(start, end, 0.05)
        assert end[2] >= tops_under(ink, radius, way, options.shaft_mm) + options.lift_mm - 1e-9
        # No higher than its own ends and the ink about its way ask for.
        wide = tops_under(np.column_stack([ink[:, :2], high]), radius, way, options.shaft_mm * 2)
        after = np.flatnonzero(toolpath.kind[move:] == MoveKind.WRITE)[0] + move
        before = np.flatnonzero(toolpath.kind[:move] == MoveKind.WRITE)[-1]
        ends = max(toolpath.end[before, 2], toolpath.start[after, 2])
        assert end[2] <= max(wide, ends) + options.lift_mm + 1e-9
    assert across > 5


@pytest.mark.parametrize("name", PATHS)
def test_the_needle_goes_up_and_down_fast_only_where_no_ink_stands_about(name):
    net, options = PATHS[name]
    toolpath = plan_embedded(net, replace(options, open_joints=9)).toolpath
    fast = (toolpath.kind == MoveKind.TRAVEL) & (toolpath.speed_mm_s > options.lift_speed_mm_s)
    upright = (toolpath.start[:, :2] == toolpath.end[:, :2]).all(axis=1)
    rows = np.flatnonzero(fast & upright).tolist()
    slow = (toolpath.kind == MoveKind.TRAVEL) & ~fast
    assert rows
    assert slow.any()
    for move in rows:
        ink, radius, _ = written_before(toolpath, move)
        top = tops_under(ink, radius, toolpath.end[[move]], options.shaft_mm)
        lowest = min(toolpath.start[move, 2], toolpath.end[move, 2])
        assert lowest >= top + options.lift_mm - 1e-9


def test_low_travels_are_taken_where_the_way_is_free():
    toolpath = embedded_toolpath(random_tree(20, 10, 3, 0.1), OPTIONS)
    across = np.any(toolpath.start[:, :2] != toolpath.end[:, :2], axis=1)
    level = toolpath.end[(toolpath.kind == MoveKind.TRAVEL) & across, 2]
    written = toolpath.end[toolpath.kind == MoveKind.WRITE, 2]
    assert (level < written.max()).sum() > len(level) / 2


def test_a_head_is_changed_above_everything_written():
    net = random_tree(12, 10, 3, 0.1)
    heads = EmbeddedHeads((OPTIONS, OPTIONS), np.arange(net.vessel_count) % 2)
    toolpath = plan_embedded(net, heads).toolpath
    changes = np.flatnonzero(np.diff(toolpath.tool) != 0)
    assert len(changes) > 0
    for row in changes.tolist():
        ink, radius, _ = written_before(toolpath, row + 1)
        assert toolpath.end[row, 2] >= (ink[:, 2] + radius).max() + OPTIONS.lift_mm - 1e-9


def kinds_between(toolpath, vessel, after):
    """Kinds of the moves between the last one that writes a vessel and the first of the next."""
    write = toolpath.kind == MoveKind.WRITE
    last = np.flatnonzero(write & (toolpath.source == vessel))[-1]
    first = np.flatnonzero(write & (toolpath.source == after))[0]
    return toolpath.kind[last + 1 : first].tolist()


def test_the_plunger_is_relieved_in_place_where_a_pass_goes_on_much_thinner():
    line = np.array([[0.0, 0, 0], [5, 0, 0], [10, 0, 0]])
    net = polylines([line[:2], line[1:]], 0.15)
    stepped = replace(net, radius=np.repeat([0.4, 0.15], 2))
    assert kinds_between(embedded_toolpath(stepped, OPTIONS), 0, 1) == [
        MoveKind.RETRACT,
        MoveKind.PRIME,
    ]
    alike = replace(net, radius=np.repeat([0.2, 0.15], 2))
    assert kinds_between(embedded_toolpath(alike, OPTIONS), 0, 1) == []


SHAFT = 0.2


@pytest.mark.parametrize("seed", first_of(range(6), 2))
def test_the_ground_is_never_below_the_highest_ink_nor_far_above(seed):
    rng = np.random.default_rng(seed)
    line = np.cumsum(rng.normal(0, [0.5, 0.5, 1.0], (12, 3)), axis=0)
    radius = rng.uniform(0.05, 0.3, 12)
    ground = ground_under(line, SHAFT, 0.3)
    lay(ground, line, radius, SHAFT)
    thick = np.maximum(radius[1:], radius[:-1])
    pieces = [way_sampled(a, b) for a, b in pairwise(line)]
    ink = np.concatenate(pieces)
    width = np.repeat(thick, [len(piece) for piece in pieces])
    tip = np.repeat(np.maximum(line[1:, 2], line[:-1, 2]), [len(piece) for piece in pieces])
    for _ in range(40):
        a, b = rng.uniform(line.min(axis=0) - 1, line.max(axis=0) + 1, (2, 3))
        found = highest_along(ground, a, b)
        way = way_sampled(a, b)
        assert found >= tops_under(ink, width, way, SHAFT)
        # Cells are a third of the shaft's radius wide: two of them more, and the stretch's top.
        high = np.column_stack([ink[:, :2], tip])
        assert found <= tops_under(high, width, way, SHAFT * 5 / 3 + 0.03)


# Vessels left out when no order avoids the needle; joints left open.


LEAVES = EmbeddedOptions(overlap_radii=0.5, leave_out=True)
RADIUS_MM, GAP_MM = 0.1, 0.215
"""Needle's radius and filament's are 0.255 mm together; filaments that near don't overlap."""


def bars(gaps):
    """Bars of 5 mm side by side, at one height."""
    places = np.cumsum([0.0, *gaps])
    nodes = [(x, y, 0) for y in places for x in (0, 5)]
    return network(nodes, [(2 * k, 2 * k + 1) for k in range(len(places))], RADIUS_MM)


def written(plan):
    return set(plan.toolpath.source[plan.toolpath.kind == MoveKind.WRITE].tolist())


def test_of_two_vessels_that_bar_each_other_one_is_left_out_and_named():
    plan = plan_embedded(bars([GAP_MM]), LEAVES)
    (out,) = plan.report.left_out
    assert plan.report.crossings == ()
    assert written(plan) == {1 - out.vessel}
    assert out.other == 1 - out.vessel
    assert out.apart_mm == pytest.approx(0.255 - GAP_MM, abs=0.002)
    assert plan.report.design_ul == pytest.approx(np.pi * RADIUS_MM**2 * 5, rel=1e-6)


def test_what_is_said_to_be_enough_is():
    (out,) = plan_embedded(bars([GAP_MM]), LEAVES).report.left_out
    apart = plan_embedded(bars([GAP_MM + out.apart_mm + 0.001]), LEAVES).report
    thinner = replace(LEAVES, needle_inner_mm=0.1, needle_outer_mm=out.needle_mm)
    for report in (apart, plan_embedded(bars([GAP_MM]), thinner).report):
        assert report.left_out == ()
        assert report.crossings == ()
    wider = replace(thinner, needle_outer_mm=out.needle_mm * 1.05)
    assert plan_embedded(bars([GAP_MM]), wider).report.left_out != ()


def test_a_vessel_that_supplies_nothing_is_rather_left_out():
    # A short trunk feeds two long branches; a longer bar lies beside the trunk.
    nodes = [(0, 0, 0), (2, 0, 0), (8, 4, 0), (8, -4, 0), (-3, GAP_MM, 0), (1.0, GAP_MM, 0)]
    net = network(nodes, [(0, 1), (1, 2), (1, 3), (4, 5)], RADIUS_MM)
    report = plan_embedded(net, LEAVES).report
    assert [one.vessel for one in report.left_out] == [3]
    assert report.cut_off == ()
    assert Supply(net).cut_off({0}) == [1, 2]
    assert Supply(net).cut_off({1}) == []


def test_a_network_of_which_nothing_can_be_written_is_refused():
    spiral = np.array([(0, 0, 0), (4, 0, 0), (4, 2, 0), (2, 2, 0), (2, 0.2, 0)], dtype=float)
    options = replace(LEAVES, needle_outer_mm=0.6)
    with pytest.raises(ToolpathError, match="no vessel can be written"):
        plan_embedded(polylines([spiral], 0.1), options)


@pytest.mark.parametrize("seed", first_of([4, 2, 8]))
def test_what_is_written_of_a_crowded_tree_crosses_nothing(seed):
    net = random_tree(30, 5, seed, 0.12)
    options = replace(LEAVES, open_joints=99)
    plan = plan_embedded(net, options)
    assert plan.report.left_out
    assert plan.report.crossings == ()
    assert written(plan) == set(range(net.vessel_count)) - {
        one.vessel for one in plan.report.left_out
    }
    assert crossings(plan.toolpath, net, options.needle_outer_mm / 2) == set()


@pytest.mark.parametrize("tree", first_of([(16, 23), (12, 5), (30, 16)]))
def test_a_vessel_that_the_first_order_bars_is_written_at_another_place(tree):
    """Two of the first tree and one of the others were left out (2026-11-30)."""
    net = random_tree(tree[0], 5, tree[1], 0.12)
    options = replace(LEAVES, open_joints=99)
    plan = plan_embedded(net, options)
    assert plan.report.left_out == ()
    assert written(plan) == set(range(net.vessel_count))
    assert plan.report.crossings == ()
    assert crossings(plan.toolpath, net, options.needle_outer_mm / 2) == set()


def test_a_vessel_is_rather_left_out_than_that_a_joint_too_many_stays_open():
    net = random_tree(16, 5, 22, 0.12)
    free, strict = (
        plan_embedded(net, replace(LEAVES, open_joints=count)).report for count in (2, 1)
    )
    assert (len(free.left_out), len(free.open)) == (3, 2)
    assert (len(strict.left_out), len(strict.open)) == (4, 1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", first_of(range(6), 2))
def test_no_network_is_crossed_once_vessels_may_be_left_out(seed):
    net, (outer, tip, cone) = random_network(seed)
    options = replace(
        LEAVES,
        open_joints=9999,
        needle_inner_mm=0.1,
        needle_outer_mm=outer,
        tip_outer_mm=tip if cone else 0.0,
        cone_mm=cone,
    )
    assert plan_embedded(net, options).report.crossings == ()


# Waiting for the bath to close behind the needle before writing across its path.


PATIENT = EmbeddedOptions(overlap_radii=0.5, open_joints=99)


def youngest_wake(path: Toolpath, radius_mm: float) -> float:
    """Age of the freshest wake of another pass in which ink is written, s: a slow check.

    The way down to a pass is its own.
    """
    lasts = path.duration_s.copy()
    moving = path.speed_mm_s > 0
    lasts[moving] = path.lengths[moving] / path.speed_mm_s[moving]
    clock = np.concatenate([[0.0], np.cumsum(lasts)])
    number, seen, down = 0, [], []
    for k in range(len(path)):
        way = path.end[k] - path.start[k]
        if path.kind[k] == MoveKind.TRAVEL and way[2] < 0 and not way[:2].any():
            down.append(k)
        if path.kind[k] == MoveKind.TRAVEL and k + 1 < len(path):
            ahead = path.kind[k + 1 :]
            works = np.flatnonzero((ahead == MoveKind.WRITE) | (ahead == MoveKind.TRAVEL))
            if len(works) and ahead[works[0]] == MoveKind.WRITE:
                number += 1
        for share in np.linspace(0, 1, 1 + max(1, int(path.lengths[k] / 0.05))):
            at = path.start[k] + share * way
            owner = number if path.kind[k] != MoveKind.TRAVEL else -1
            writes = path.kind[k] == MoveKind.WRITE
            seen.append((*at, clock[k] + share * lasts[k], owner, k, writes))
    rows = np.array(seen)
    youngest = np.inf
    for row in rows[rows[:, 6] > 0]:
        past = rows[(rows[:, 3] < row[3]) & (rows[:, 4] != row[4]) & (rows[:, 3] > row[3] - 60)]
        past = past[~np.isin(past[:, 5], _own_descent(path, int(row[5]), down))]
        near = np.hypot(past[:, 0] - row[0], past[:, 1] - row[1]) < 0.9 * radius_mm
        near &= past[:, 2] < row[2]
        if near.any():
            youngest = min(youngest, float(row[3] - past[near, 3].max()))
    return youngest


def _own_descent(path: Toolpath, move: int, down: list[int]) -> list[int]:
    first = move
    while first > 0 and path.kind[first - 1] != MoveKind.TRAVEL:
        first -= 1
    found = []
    while first - 1 in down or (first > 0 and path.kind[first - 1] == MoveKind.DWELL):
        first -= 1
        found.append(first)
    return found


@pytest.mark.parametrize("seed", [1, 4])
def test_no_ink_is_laid_in_a_younger_wake(seed: int) -> None:
    net = random_tree(6, 8.0, seed, 0.12)
    plain = plan_embedded(net, PATIENT).toolpath
    assert youngest_wake(plain, PATIENT.shaft_mm) < 4.0
    plan = plan_embedded(net, replace(PATIENT, recovery_s=4.0))
    assert youngest_wake(plan.toolpath, PATIENT.shaft_mm) >= 4.0 - 0.1
    assert plan.report.waited_s > 0
    moves = plan.toolpath.kind != MoveKind.DWELL
    assert np.array_equal(plan.toolpath.end[moves], plain.end[plain.kind != MoveKind.DWELL])


def test_needle_waits_above_the_pass_and_not_in_the_old_wake() -> None:
    plan = plan_embedded(random_tree(6, 8.0, 1, 0.12), replace(PATIENT, recovery_s=30.0))
    path = plan.toolpath
    dwells = np.flatnonzero(path.kind == MoveKind.DWELL)
    assert len(dwells)
    for row in dwells:
        write = row + int(np.flatnonzero(path.kind[row:] == MoveKind.WRITE)[0])
        assert path.start[row, 2] > path.start[write, 2]
        assert np.allclose(path.start[row, :2], path.start[write, :2])
        assert path.kind[row + 1] == MoveKind.TRAVEL
