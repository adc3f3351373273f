"""Embedded plans of difficult networks, judged by independent checkers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.errors import ToolpathError
from design.toolpath import MoveKind
from design.toolpath.embedded import EmbeddedOptions, plan_embedded
from tests.design.toolpath.joint_checker import bodies
from tests.design.toolpath.shaft_checker import crossings
from tests.design.toolpath.shapes import (
    cage,
    helix,
    network,
    polyline,
    polylines,
    random_tree,
    ring,
)
from tests.slower import examples, first_of

OPTIONS = EmbeddedOptions()
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
    monkeypatch.setattr("design.toolpath.embedded.improve.ROUNDS", 1)
    monkeypatch.setattr("design.toolpath.embedded.joints.PARTS", (1.0,))
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
