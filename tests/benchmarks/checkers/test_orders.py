"""Counting of elements by diameter, on a tree drawn by hand."""

import numpy as np
import pytest

from benchmarks.checkers.networks import Pieces
from benchmarks.checkers.orders import elements_by_diameter, published_table


def test_an_element_is_a_series_of_vessels_of_one_order() -> None:
    """A root in two vessels of order 2; of its second node a wide and two thin branches leave."""
    places = np.array(
        [[0.0, 0, 0], [2, 0, 0], [4, 0, 0], [5, 0, 0], [7, 0, 0], [2, 1, 0], [4, 3, 0]]
    )
    node = np.array([[0, 1], [1, 2], [2, 3], [3, 4], [1, 5], [2, 6]])
    vessel = np.array([0, 1, 2, 2, 3, 4])  # the third has a bend at node 3
    across = np.array([1.0, 1.0, 1.0, 1.0, 0.3, 0.3])
    net = Pieces(
        vessel,
        np.zeros(6, int),
        np.full(6, "artery"),
        node,
        places[node[:, 0]],
        places[node[:, 1]],
        np.column_stack([across, across]) / 2,
    )
    found = elements_by_diameter(net, np.array([0.5]))
    assert found[2] == {"elements": 1, "diameter_mm": 1.0, "length_mm": 7.0}
    assert found[1]["elements"] == 2
    assert found[1]["length_mm"] == pytest.approx(2.0)


def test_of_two_branches_of_the_parents_order_the_wider_goes_on() -> None:
    places = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 3, 0]])
    node, across = np.array([[0, 1], [1, 2], [1, 3]]), np.array([1.0, 0.8, 0.9])
    net = Pieces(
        np.arange(3),
        np.zeros(3, int),
        np.full(3, "artery"),
        node,
        places[node[:, 0]],
        places[node[:, 1]],
        np.column_stack([across, across]) / 2,
    )
    assert elements_by_diameter(net, np.array([0.5]))[2]["elements"] == 2
    assert elements_by_diameter(net, np.array([0.5]))[2]["length_mm"] == pytest.approx(2.5)


def test_the_published_table_is_read_as_it_stands() -> None:
    wide = published_table()[:, 0]
    assert len(wide) == 11
    assert (np.diff(wide) > 0).all()
