"""Vessels omitted when no order avoids the needle; joints left open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.errors import ToolpathError
from design.toolpath import MoveKind
from design.toolpath.embedded import EmbeddedOptions, plan_embedded
from design.toolpath.embedded.left_out import Supply
from tests.design.toolpath.random_networks import random_network
from tests.design.toolpath.shaft_checker import crossings
from tests.design.toolpath.shapes import network, polylines, random_tree
from tests.slower import first_of

LEAVES = EmbeddedOptions(leave_out=True)
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
