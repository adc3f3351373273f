"""A network's orders and radii beside published tables."""

import numpy as np
import pytest

from design.measures import compare_orders
from design.measures.published_comparison import published_match, published_orders
from design.network import VesselNetwork
from tests.design.networks import network


def comb(diameters, lengths) -> VesselNetwork:
    """A stem for each diameter but the first, of six pieces, each with a branch of the first."""
    nodes, ends, radius = [], [], []
    for row, (wide, long) in enumerate(zip(diameters, lengths, strict=True)):
        nodes.append([0.0, 50.0 * row, 0.0])
        at = len(nodes) - 1
        for n in range(6):
            nodes.append([long / 6 * (n + 1), 50.0 * row, 0.0])
            ends.append((at, len(nodes) - 1))
            radius.append(wide / 2)
            at = len(nodes) - 1
    return network(nodes, ends, radius)


def test_table_holds_the_published_figures_of_the_right_coronary():
    table = published_orders("coronary")
    # RCA 132 and LAD 139 µm; 1.64 and 1.31 mm.
    assert table.diameter_mm[5, 0] == pytest.approx(0.1355)
    assert table.length_mm[5, 0] == pytest.approx(1.475)
    assert np.isnan(table.length_mm[10, 1])
    first = table.diameter_ratio[table.diameter_ratio[:, 0] == 10, 1]
    assert sorted(first) == pytest.approx(sorted([3218 / 1302, 3176 / 1573]))


def test_vessels_take_the_order_that_their_diameter_has():
    found = compare_orders(comb([0.13, 0.28, 0.7], [1.5, 3.3, 9.0]), "coronary")
    assert [row["order"] for row in found["orders"]] == [6, 7, 9]
    assert [row["length_mm"]["ours"] for row in found["orders"]] == pytest.approx([1.5, 3.3, 9.0])
    # One element each: nothing is judged.
    assert all(row["length_mm"]["inside"] is None for row in found["orders"])


def test_five_elements_are_judged_by_one_standard_deviation():
    for long, inside in ((2.4, True), (3.0, False)):
        found = compare_orders(comb([0.135] * 5, [long] * 5), "coronary")
        assert found["orders"][0]["length_mm"]["inside"] is inside


def fork(degrees_wider: float, degrees_narrower: float) -> VesselNetwork:
    """A stem along x, and two straight children in one plane, on two sides of it."""
    one, two = np.radians([degrees_wider, -degrees_narrower])
    ends = [[10 + 8 * np.cos(a), 8 * np.sin(a), 0.0] for a in (one, two)]
    nodes = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], *ends]
    return network(nodes, [[0, 1], [1, 2], [1, 3]], [0.5, 0.4, 0.2])


def test_angles_and_asymmetry_of_a_fork_are_its_own():
    rows = compare_orders(fork(20.0, 50.0), "coronary")["forks"]
    ours = {(row["measure"], row["at"]): row["ours"] for row in rows}
    names = ("between_deg", "wider_deg", "narrower_deg", "diameter_ratio", "area_ratio")
    found = [ours[name, "all"] for name in names]
    assert found == pytest.approx([70.0, 20.0, 50.0, 0.5, (0.16 + 0.04) / 0.25])


def test_a_trees_first_fork_is_told_apart():
    nodes = [[0, 0, 0], [10, 0, 0], [18, 4, 0], [16, -6, 0], [24, 4, 0], [22, 12, 0]]
    ends = [[0, 1], [1, 2], [1, 3], [2, 4], [2, 5]]
    net = network(nodes, ends, [0.5, 0.4, 0.2, 0.3, 0.27])
    rows = compare_orders(net, "coronary")["forks"]
    found = {row["at"]: row["ours"] for row in rows if row["measure"] == "between_deg"}
    first, second = np.degrees([np.arctan(1 / 2) + np.pi / 4, np.arctan(2)])
    assert found == pytest.approx({"first": first, "all": (first + second) / 2})


@pytest.mark.parametrize("organ", ["kidney", "lung", "liver"])
def test_what_is_not_published_is_told_and_not_judged(organ):
    found = compare_orders(fork(20.0, 50.0), organ)
    (ratio,) = [row for row in found["forks"] if row["measure"] == "diameter_ratio"]
    assert (ratio["mean"], ratio["source"], ratio["inside"]) == (None, None, None)
    assert any("symmetry" in why for why in found["left_out"])
    assert bool(found["orders"]) == (organ != "liver")


# Radii brought to a published table by one factor.


def vessels(
    scale: float, orders: range = range(5, 10), lowest_longer: float = 1.0
) -> VesselNetwork:
    """Vessels by themselves with the published diameters, lengths and numbers, radii scaled."""
    table = published_orders("coronary")
    counts = [round(2000 / 3.66**n) for n in range(len(orders))]
    radius = np.repeat([0.5 * scale * table.diameter_mm[n, 0] for n in orders], counts)
    length = np.repeat([table.length_mm[n, 0] for n in orders], counts)
    length[: counts[0]] *= lowest_longer
    count = len(radius)
    begin = np.column_stack([np.zeros(count), 10.0 * np.arange(count), np.zeros(count)])
    nodes = np.concatenate([begin, begin + length[:, None] * (1.0, 0.0, 0.0)])
    ends = np.column_stack([np.arange(count), count + np.arange(count)])
    return network(nodes, ends, radius, tree=np.arange(count))


def test_vessels_within_the_published_spread_and_small_trees_keep_their_radii():
    assert published_match(vessels(1.0), "coronary").factor == 1.0
    assert published_match(vessels(0.72, range(7, 10)), "coronary").factor == 1.0


def farthest_sd(net: VesselNetwork) -> float:
    """The judged figure farthest from its published mean, in standard deviations."""
    found = compare_orders(net, "coronary")
    figures = list(found["ratios"].values())
    for row in found["orders"]:
        figures += [row["diameter_mm"], row["length_mm"], row["length_over_diameter"]]
    judged = [one for one in figures if one["inside"] is not None]
    return max(abs(one["ours"] - one["mean"]) / one["sd"] for one in judged)


def test_an_order_off_the_table_is_not_scaled_until_it_is_not_judged():
    """A heart's radii were half as large again: without its lowest order all figures fitted."""
    whole = published_match(vessels(1.0), "coronary")
    assert published_match(vessels(1.0, lowest_longer=2.0), "coronary") == (whole.within - 2, 1.0)


@pytest.mark.parametrize("scale", [0.72, 1.35])
def test_one_factor_brings_all_orders_within_the_spread(scale):
    thin = vessels(scale)
    factor = published_match(thin, "coronary").factor
    assert farthest_sd(thin) > 1.0
    assert factor == pytest.approx(1.0 / scale, rel=0.25)
    # By a margin: with the first factor that fits a heart grown anew was out again, 1.003 sd away.
    assert farthest_sd(vessels(scale * factor)) < 0.8
    assert (factor - 1.0) * (1.0 - scale) > 0.0
    orders = compare_orders(vessels(scale * factor), "coronary")["orders"]
    judged = [row["diameter_mm"]["inside"] for row in orders]
    assert False not in judged
    assert judged.count(True) >= 4
