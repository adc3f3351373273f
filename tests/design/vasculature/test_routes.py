"""Routed connections around obstacles, and terminals that stay unjoined."""

import numpy as np
import pytest

from design.errors import GrowthError
from design.hemodynamics import FlowConditions, balance, flow_spread
from design.network import VesselKind
from design.vasculature import (
    GrowthOptions,
    LoopOptions,
    RootSpec,
    close_loops,
    collisions,
    grow_forest,
)
from design.vasculature.loops.connect import Web
from design.vasculature.loops.curve_fit import KIN, Ends, radius_for
from design.vasculature.loops.loops import open_web, tree_ends
from design.vasculature.loops.routes import RouteObstacles, find_route
from tests.design.tissue import surfaces
from tests.design.tissue.kept import kept_tissue

RADIUS = 0.1


@pytest.fixture(scope="module")
def torus():
    shape = surfaces.torus()
    return kept_tissue(shape)


@pytest.fixture(scope="module")
def web(torus):
    settings = GrowthOptions(terminals=4)
    ends, vessels = tree_ends(grow_forest(torus, [settings, settings]))
    found = open_web(torus, ends, np.arange(4), vessels, LoopOptions())
    # Nothing in the way but the surface.
    found.capsules["there"] = 0
    return found


def ends_at(here, there, ahead, behind):
    return Ends(
        np.array([here, there], dtype=float),
        np.array([ahead, behind], dtype=float),
        np.full(2, RADIUS),
        np.full((2, KIN), -1),
        np.zeros((2, KIN)),
        0.0,
    )


@pytest.fixture(scope="module")
def across(torus):
    """Two ends on either side of the torus's hole that look at each other across it."""
    middle = 0.5 * (np.abs(torus.surface.vertices[:, :2]).max() + radii_of(torus).min())
    return ends_at([middle, 0, 0], [-middle, 0, 0], [-0.5, 0.5**0.5, 0.5], [0.5, 0.5**0.5, -0.5])


def radii_of(tissue):
    return np.linalg.norm(tissue.surface.vertices[:, :2], axis=1)


def crowd_of(web, **rule):
    return RouteObstacles(web.rule._replace(**rule), web.index, web.capsules, web.bounds)


@pytest.mark.slow
def test_a_way_round_the_hole_is_found_and_holds_the_rules(web, across, torus):
    assert not torus.grid.capsule_inside(across.point[:1], across.point[1:], np.zeros(1))[0]
    route = find_route(across, crowd_of(web))
    assert route is not None
    points = route.points
    np.testing.assert_array_equal(points[[0, -1]], across.point)
    step = np.diff(points, axis=0)
    length = np.linalg.norm(step, axis=1)
    assert torus.grid.capsule_inside(
        points[:-1], points[1:], np.full(len(step), route.radius)
    ).all()
    assert route.radius == pytest.approx(radius_for(length.sum(), across, web.rule), rel=1e-12)
    # Half a turn around the hole at least, and no detour.
    inner = radii_of(torus).min()
    assert np.pi * inner < length.sum() < 1.2 * np.pi * np.abs(torus.surface.vertices[:, 0]).max()
    unit = step / length[:, None]
    limit = web.rule.straight - 1e-12
    assert unit[0] @ across.direction[0] / np.linalg.norm(across.direction[0]) >= limit
    assert -unit[-1] @ across.direction[1] / np.linalg.norm(across.direction[1]) >= limit
    turn = np.arccos(np.clip((unit[1:] * unit[:-1]).sum(axis=1), -1, 1))
    arc = 0.5 * (length[1:] + length[:-1])
    assert (turn <= 1.2 * arc / (web.rule.bend * route.radius) + 1e-9).all()


def test_a_few_that_find_no_way_are_pruned_and_counted(torus, monkeypatch):
    settings = GrowthOptions(terminals=40)
    trees = grow_forest(torus, [RootSpec(settings), RootSpec(settings, VesselKind.VEIN)])
    whole = close_loops(torus, *trees)
    assert (whole.connections, whole.pruned) == (40, 0)
    whole_way = Web.lay_all

    def all_but_two(web):
        whole_way(web)
        for number in (3, 17):
            web._fell(number)

    monkeypatch.setattr(Web, "lay_all", all_but_two)
    with pytest.raises(GrowthError, match=r"2 of 40 connections found no way .* \(0 may be"):
        close_loops(torus, *trees)
    fewer = close_loops(torus, *trees, LoopOptions(prune_part=0.05))
    assert (fewer.connections, fewer.pruned) == (38, 2)
    network = fewer.network
    assert (network.kind == VesselKind.CONNECTION).sum() == 38
    assert len(network.inlets()) == len(network.outlets()) == 1
    assert collisions(network, 0.0, 0.1).count == 0
    conditions = FlowConditions(4e-3, inlet_flow_ul_s=1.0)
    assert flow_spread(network, conditions) > 1e-3
    narrowed = balance(network, conditions, widen=False)
    assert flow_spread(narrowed, conditions) < 1e-9
    assert collisions(narrowed, 0.0, 0.1).count == 0
