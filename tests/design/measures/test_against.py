"""A network's orders beside published tables."""

import numpy as np
import pytest

from design.measures import compare_orders
from design.measures.published_comparison import published_orders
from design.network import VesselNetwork


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
    count = len(ends)
    zero = np.zeros(count, dtype=np.int64)
    return VesselNetwork.from_segments(
        np.array(nodes), np.array(ends), np.array(radius), zero, zero
    )


def test_table_holds_the_published_figures_of_the_right_coronary():
    table = published_orders("coronary")
    # RCA 132 and LAD 139 µm; 1.64 and 1.31 mm.
    assert table.diameter_mm[5, 0] == pytest.approx(0.1355)
    assert table.length_mm[5, 0] == pytest.approx(1.475)
    assert np.isnan(table.length_mm[10, 1])
    first = table.diameter_ratio[table.diameter_ratio[:, 0] == 10, 1]
    assert sorted(first) == pytest.approx(sorted([3218 / 1302, 3176 / 1573]))


def test_vessels_take_the_order_that_their_diameter_has():
    network = comb([0.13, 0.28, 0.7], [1.5, 3.3, 9.0])
    found = compare_orders(network, "coronary")
    assert [row["order"] for row in found["orders"]] == [6, 7, 9]
    assert [row["length_mm"]["ours"] for row in found["orders"]] == pytest.approx([1.5, 3.3, 9.0])
    # One element each: nothing is judged.
    assert all(row["length_mm"]["inside"] is None for row in found["orders"])


def test_five_elements_are_judged_by_one_standard_deviation():
    long = comb([0.135] * 5, [2.4] * 5)
    longer = comb([0.135] * 5, [3.0] * 5)
    assert compare_orders(long, "coronary")["orders"][0]["length_mm"]["inside"] is True
    assert compare_orders(longer, "coronary")["orders"][0]["length_mm"]["inside"] is False


def fork(degrees_wider: float, degrees_narrower: float) -> VesselNetwork:
    """A stem along x, and two straight children in one plane, on two sides of it."""
    one, two = np.radians([degrees_wider, -degrees_narrower])
    ends = [[10 + 8 * np.cos(a), 8 * np.sin(a), 0.0] for a in (one, two)]
    nodes = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], *ends])
    zero = np.zeros(3, dtype=np.int64)
    return VesselNetwork.from_segments(
        nodes, np.array([[0, 1], [1, 2], [1, 3]]), np.array([0.5, 0.4, 0.2]), zero, zero
    )


def test_angles_and_asymmetry_of_a_fork_are_its_own():
    rows = compare_orders(fork(20.0, 50.0), "coronary")["forks"]
    ours = {(row["measure"], row["at"]): row["ours"] for row in rows}
    assert ours["between_deg", "all"] == pytest.approx(70.0)
    assert ours["wider_deg", "all"] == pytest.approx(20.0)
    assert ours["narrower_deg", "all"] == pytest.approx(50.0)
    assert ours["diameter_ratio", "all"] == pytest.approx(0.5)
    assert ours["area_ratio", "all"] == pytest.approx((0.16 + 0.04) / 0.25)


@pytest.mark.parametrize("organ", ["kidney", "lung", "liver"])
def test_what_is_not_published_is_told_and_not_judged(organ):
    found = compare_orders(fork(20.0, 50.0), organ)
    (ratio,) = [row for row in found["forks"] if row["measure"] == "diameter_ratio"]
    assert (ratio["mean"], ratio["source"], ratio["inside"]) == (None, None, None)
    assert any("symmetry" in why for why in found["left_out"])
    assert bool(found["orders"]) == (organ != "liver")
