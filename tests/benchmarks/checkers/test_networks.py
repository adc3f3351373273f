"""Checkers of networks: their file, Murray's law, flow, orders by diameter."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.checkers import (
    Perfusion,
    consistent_radii,
    loop_flows,
    murray_ratios,
    murray_residual,
    outlet_flows,
    read_network,
    spread,
)
from benchmarks.checkers.networks import graph_flows, resistances, tree_flows
from benchmarks.checkers.orders import elements_by_diameter, published_table
from tests.benchmarks.checkers.nets import fork, net_of, random_tree

HEADER = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"


def test_columns_are_found_by_name_and_nodes_numbered_without_gaps(tmp_path):
    path = tmp_path / "network.csv"
    path.write_text(
        "tree,vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind\n"
        "3,0,70,9,0,0,0,1,0,0,0.25,0.5,vein\n"
        "3,1,9,500,1,0,0,1,2,0,0.1,0.1,vein\n"
    )
    net = read_network(path)
    assert net.node.tolist() == [[1, 0], [0, 2]]
    assert net.length.tolist() == [1.0, 2.0]
    assert net.radius.tolist() == [[0.25, 0.5], [0.1, 0.1]]
    assert net.kind.tolist() == ["vein", "vein"]
    assert net.tree.tolist() == [3, 3]
    assert net.inlets().tolist() == [1]
    assert net.outlets().tolist() == [2]


def test_numbers_keep_all_their_bits(tmp_path):
    values = np.random.default_rng(1).uniform(0.1, 1.0, 8)
    row = ",".join(repr(float(v)) for v in values)
    (tmp_path / "n.csv").write_text(f"{HEADER}0,0,1,{row},artery,0\n")
    net = read_network(tmp_path / "n.csv")
    assert np.concatenate([net.start[0], net.end[0], net.radius[0]]).tolist() == values.tolist()


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        ("0,0,1,0,0,0,1,0,0,0.1,0.1,artery,0\n1,1,2,1,0,0.1,2,0,0,0.1,0.1,artery,0\n", "apart"),
        ("0,0,1,0,0,0,1,0,0,0.1,0,artery,0\n", "above 0"),
        ("0,0,1,0,0,nan,1,0,0,0.1,0.1,artery,0\n", "NaN"),
    ],
)
def test_what_is_no_network_is_refused(tmp_path, rows, says):
    (tmp_path / "n.csv").write_text(HEADER + rows)
    with pytest.raises(ValueError, match=says):
        read_network(tmp_path / "n.csv")


def test_a_missing_column_is_named(tmp_path):
    (tmp_path / "n.csv").write_text("vessel,node0\n0,1\n")
    with pytest.raises(ValueError, match="radius0_mm"):
        read_network(tmp_path / "n.csv")


def test_murrays_law_is_kept_by_equal_branches_and_a_wrong_radius_told():
    branch = 0.1 * 2 ** (-1 / 3)
    assert murray_residual(fork([0.1, branch, branch])) < 1e-15
    assert murray_residual(fork([0.1, branch, branch]), exponent=2.0) > 0.2
    assert murray_ratios(fork([0.1, branch, 2 * branch])) == pytest.approx([4.5])
    assert murray_residual(fork([0.1, branch, 2 * branch])) == pytest.approx(3.5)


def test_bends_and_ends_are_no_branches():
    bend = net_of([[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 1], [1, 2]], [0.1, 0.3])
    assert len(murray_ratios(bend)) == 0
    assert murray_residual(bend) == 0


@pytest.mark.parametrize("exponent", [2.0, 2.7, 3.0])
def test_consistent_radii_keep_murrays_law(exponent):
    perfusion = Perfusion(13.0, 5300.0, 4e-3, exponent)
    radius = consistent_radii(random_tree(np.random.default_rng(7), 200), perfusion)
    net = random_tree(np.random.default_rng(7), 200, radius)
    assert murray_residual(net, exponent) < 1e-12


def test_what_is_no_binary_tree_is_refused():
    star = net_of(np.eye(5, 3), [[0, 1], [1, 2], [1, 3], [1, 4]], 0.1)
    with pytest.raises(ValueError, match="binary"):
        consistent_radii(star, Perfusion(1.0, 1.0, 1.0))


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
        net = random_tree(np.random.default_rng(6), terminals, widened)
        assert spread(outlet_flows(net, 5300.0, 4e-3)) > 0.1


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


def test_an_element_is_a_series_of_vessels_of_one_order() -> None:
    """A root in two vessels of order 2; of its second node a wide and two thin branches leave."""
    places = [[0, 0, 0], [2, 0, 0], [4, 0, 0], [5, 0, 0], [7, 0, 0], [2, 1, 0], [4, 3, 0]]
    edges = [[0, 1], [1, 2], [2, 3], [3, 4], [1, 5], [2, 6]]
    net = net_of(places, edges, [0.5, 0.5, 0.5, 0.5, 0.15, 0.15])
    net = replace(net, vessel=np.array([0, 1, 2, 2, 3, 4]))  # the third has a bend at node 3
    found = elements_by_diameter(net, np.array([0.5]))
    assert found[2] == {"elements": 1, "diameter_mm": 1.0, "length_mm": 7.0}
    assert found[1]["elements"] == 2
    assert found[1]["length_mm"] == pytest.approx(2.0)


def test_of_two_branches_of_the_parents_order_the_wider_goes_on() -> None:
    places = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 3, 0]]
    net = net_of(places, [[0, 1], [1, 2], [1, 3]], [0.5, 0.4, 0.45])
    found = elements_by_diameter(net, np.array([0.5]))[2]
    assert found["elements"] == 2
    assert found["length_mm"] == pytest.approx(2.5)


def test_the_published_table_is_read_as_it_stands() -> None:
    wide = published_table()[:, 0]
    assert len(wide) == 11
    assert (np.diff(wide) > 0).all()
