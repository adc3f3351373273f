"""Routed connections around obstacles, and terminals that stay unjoined."""

import numpy as np
import pytest

from design.errors import GrowthError
from design.hemodynamics import FlowConditions, balance, flow_spread
from design.network import VesselKind, VesselNetwork
from design.vasculature import (
    GrowthOptions,
    LoopOptions,
    RootSpec,
    close_loops,
    collisions,
    grow_forest,
)
from design.vasculature.loops.connect import Web
from design.vasculature.loops.curves import KIN, Ends, radius_for
from design.vasculature.loops.loops import open_web, pruned, tree_ends
from design.vasculature.loops.routes import RouteObstacles, find_route, swap_ends
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


@pytest.mark.slow
def test_no_way_is_thinner_than_the_least_radius(web, across):
    route = find_route(across, crowd_of(web))
    least = 1.01 * route.radius
    wider = find_route(across, crowd_of(web, least=least))
    assert wider is None or wider.radius >= least


def test_neighbours_of_a_piece_keep_apart(web, across):
    route = find_route(across, crowd_of(web))
    length = np.linalg.norm(np.diff(route.points, axis=0), axis=1)
    assert (length[1:-1] >= 2.0 * route.radius).all()
    assert (length[[0, -1]] >= route.radius + RADIUS).all()


def test_the_way_back_is_as_long(web, across):
    there, back = (find_route(ends, crowd_of(web)) for ends in (across, swap_ends(across)))
    lengths = [np.linalg.norm(np.diff(r.points, axis=0), axis=1).sum() for r in (there, back)]
    assert lengths[0] == pytest.approx(lengths[1], rel=0.1)


def test_what_is_walled_in_has_no_way(web, torus):
    middle = 0.5 * (np.abs(torus.surface.vertices[:, 0]).max() + radii_of(torus).min())
    beyond = ends_at([middle, 0, 0], [0, 0, 0], [-1, 0, 0], [1, 0, 0])
    assert find_route(beyond, crowd_of(web)) is None


def test_a_vessel_in_the_way_is_gone_round(web, torus):
    middle = 0.5 * (np.abs(torus.surface.vertices[:, 0]).max() + radii_of(torus).min())
    a = 0.12
    ends = ends_at(
        [middle * np.cos(a), -middle * np.sin(a), 0],
        [middle * np.cos(a), middle * np.sin(a), 0],
        [0, 1, 0],
        [0, -1, 0],
    )
    free = find_route(ends, crowd_of(web))
    wall = web.capsules[:1].copy()
    for name, value in zip(
        ("px", "py", "pz", "dx", "dy", "dz", "radius", "there"),
        (middle, 0, -0.4, middle, 0, 0.4, 0.1, 1),
        strict=True,
    ):
        web.capsules[name][0] = value
    web.reindex()
    round_it = find_route(ends, crowd_of(web))
    web.capsules[:1] = wall
    web.reindex()
    at = np.array([middle, 0.0])
    away = np.linalg.norm(round_it.points[:, :2] - at, axis=1)
    inside = np.abs(round_it.points[:, 2]) < 0.4
    assert (away[inside] >= 0.1 + round_it.radius).all()
    assert len(free.points) >= 5


def tree_of(ends, kind):
    nodes = np.random.default_rng(1).uniform(size=(8, 3))
    kinds = np.array(kind)
    return VesselNetwork.from_segments(nodes, ends, np.full(len(ends), 0.1), kinds, 0 * kinds)


def test_what_leads_nowhere_is_pruned_up_to_where_flow_goes_on():
    A, V, C = VesselKind.ARTERY, VesselKind.VEIN, VesselKind.CONNECTION
    # Artery 0-1 parts to 2 and 3; 3 parts to blind 4 and 5. Vein 7-6 drains 2 through 7.
    ends = [[0, 1], [1, 2], [1, 3], [3, 4], [3, 5], [2, 7], [7, 6]]
    left = pruned(tree_of(ends, [A, A, A, A, A, C, V]))
    assert left.kind.tolist() == [A, A, C, V]
    assert left.vessel_nodes.tolist() == [[0, 1], [1, 2], [2, 4], [4, 3]]
    assert len(left.nodes) == 5


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


@pytest.mark.parametrize("seed", [4, 5])
def test_pieces_leave_few_overlaps_within_joints(torus, seed):
    settings = GrowthOptions(terminals=60, seed=seed)
    trees = grow_forest(torus, [RootSpec(settings), RootSpec(settings, VesselKind.VEIN)])
    network = close_loops(torus, *trees).network
    found = collisions(network, 0.0, 0.1)
    assert found.count == 0
    assert len(found.joint_pieces) <= 0.02 * len(network.pieces()[0])
