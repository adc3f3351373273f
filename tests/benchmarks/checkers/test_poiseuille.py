from dataclasses import replace

import numpy as np
import pytest

from benchmarks.checkers import Perfusion, consistent_radii, loop_flows, outlet_flows, spread
from benchmarks.checkers.networks import graph_flows, resistances, tree_flows
from tests.benchmarks.checkers.nets import fork, net_of, random_tree


def test_resistance_is_poiseuilles_and_a_taper_is_its_integral():
    straight = net_of([[0, 0, 0], [20, 0, 0]], [[0, 1]], 0.2)
    expected = 8 * 4e-3 * 20 / (np.pi * 0.2**4)
    assert resistances(straight, 4e-3) == pytest.approx([expected], rel=1e-14)
    taper = net_of([[0, 0, 0], [20, 0, 0]], [[0, 1]], [[0.2, 0.5]])
    x = (np.arange(200_000) + 0.5) / 200_000
    integral = 20 * np.mean((0.2 + 0.3 * x) ** -4.0)
    assert resistances(taper, 4e-3) == pytest.approx([8 * 4e-3 / np.pi * integral], rel=1e-9)


def test_a_fork_divides_as_its_conductances():
    net = fork([0.2, 0.1, 0.2])
    root, thin, wide = resistances(net, 1e-3)
    flows = outlet_flows(net, 100.0, 1e-3)
    through = 100.0 / (root + 1 / (1 / thin + 1 / wide))
    assert flows.sum() == pytest.approx(through, rel=1e-14)
    assert flows[1] / flows[0] == pytest.approx(16.0, rel=1e-14)
    assert spread(flows) == pytest.approx(15 / 8.5, rel=1e-14)


def test_elimination_and_factorisation_agree_on_trees():
    net = random_tree(np.random.default_rng(4), 60)
    resistance = resistances(net, 4e-3)
    by_tree = tree_flows(net, resistance, 1000.0)
    assert by_tree == pytest.approx(graph_flows(net, resistance, 1000.0), rel=1e-8)


def test_a_wheatstone_bridge_is_solved_by_factorisation():
    """Arms of 1, 2, 3 and 4 units with a link of 5: through-flow by the textbook's formula."""
    points = np.random.default_rng(5).uniform(0, 1, (6, 3))
    edges = [[0, 1], [1, 2], [1, 3], [2, 4], [3, 4], [2, 3], [4, 5]]
    net = net_of(points, edges, 0.1)
    units = np.array([1.0, 1, 2, 3, 4, 5, 1])
    flow = graph_flows(net, units, 1.0)
    k = np.array([[1 / 1 + 1 / 3 + 1 / 5, -1 / 5], [-1 / 5, 1 / 2 + 1 / 4 + 1 / 5]])
    inner = np.linalg.solve(k, [1.0, 0.5])
    bridge = 1 / ((1 - inner[0]) / 1 + (1 - inner[1]) / 2)
    assert flow[0] == pytest.approx(1 / (2 + bridge), rel=1e-12)
    assert tree_flows(net, units, 1.0) is None
    assert flow[5] == pytest.approx(flow[1] - flow[3], rel=1e-9)


@pytest.mark.parametrize("terminals", [1, 2, 300])
def test_consistent_radii_feed_all_outlets_alike(terminals):
    bare = random_tree(np.random.default_rng(6), terminals)
    perfusion = Perfusion(flow_ul_s=13.0, drop_pa=5300.0, viscosity_pa_s=4e-3)
    radius = consistent_radii(bare, perfusion)
    net = random_tree(np.random.default_rng(6), terminals, radius)
    flows = outlet_flows(net, 5300.0, 4e-3)
    assert flows.sum() == pytest.approx(13.0, rel=1e-12)
    assert spread(flows) < 1e-12
    widened = radius * np.where(np.arange(len(radius)) == len(radius) - 1, 1.05, 1.0)
    if terminals > 1:
        assert (
            spread(
                outlet_flows(
                    random_tree(np.random.default_rng(6), terminals, widened), 5300.0, 4e-3
                )
            )
            > 0.1
        )


def test_flow_of_each_connection_is_that_of_its_pieces():
    """Two ways of two pieces each between an artery and a vein, one twice as wide."""
    points = [[0, 0, 0], [1, 0, 0], [2, 1, 0], [2, -1, 0], [3, 0, 0], [4, 0, 0]]
    edges = [[0, 1], [1, 2], [2, 4], [1, 3], [3, 4], [4, 5]]
    net = net_of(points, edges, [0.3, 0.1, 0.1, 0.2, 0.2, 0.3])
    kind = np.array(["artery", *["connection"] * 4, "vein"])
    net = replace(net, kind=kind, vessel=np.array([0, 1, 1, 2, 2, 3]))
    flows = loop_flows(net, 100.0, 1e-3)
    assert flows[1] / flows[0] == pytest.approx(16.0, rel=1e-12)
    assert flows.sum() == pytest.approx(outlet_flows(net, 100.0, 1e-3).sum(), rel=1e-12)
    with pytest.raises(ValueError, match="no vessel of kind connection"):
        loop_flows(fork(), 100.0, 1e-3)
