"""When a network's vessels came."""

import numpy as np
import pytest

from design.errors import NetworkError
from design.measures.growth_order import growth_order
from design.network import VesselKind, VesselNetwork

A, C, V = int(VesselKind.ARTERY), int(VesselKind.CONNECTION), int(VesselKind.VEIN)


def network(ends: list[tuple[int, int]], kinds: list[int]) -> VesselNetwork:
    count = max(max(pair) for pair in ends) + 1
    nodes = np.random.default_rng(1).uniform(0.0, 9.0, (count, 3))
    tree = np.array(kinds, dtype=np.int64)
    return VesselNetwork.from_segments(nodes, np.array(ends), np.ones(len(ends)), tree, tree)


def test_the_last_split_came_last() -> None:
    # 0 is parted into 0, 1 and a terminal 2; then the terminal 1 into 1, 3 and a terminal 4.
    order = growth_order(network([(0, 1), (1, 2), (1, 3), (2, 4), (2, 5)], [A] * 5))
    assert order.terminal is not None
    np.testing.assert_allclose(order.terminal, [np.nan, np.nan, 2 / 3, 1 / 3, 1.0])
    np.testing.assert_array_equal(order.generation, [0, 1, 1, 2, 2])
    np.testing.assert_allclose(order.drawn(1 / 3), [1 / 3, 1 / 2, 0, 1, 0])
    np.testing.assert_array_equal(order.drawn(1.0), np.ones(5))


def test_a_connection_comes_with_the_later_of_its_terminals() -> None:
    ends = [(0, 1), (1, 2), (1, 3), (5, 4), (6, 5), (7, 5), (2, 6), (3, 7)]
    order = growth_order(network(ends, [A, A, A, V, V, V, C, C]))
    assert order.terminal is not None
    np.testing.assert_allclose(order.terminal[[1, 2, 4, 5, 6, 7]], [0.5, 1, 0.5, 1, 0.5, 1])
    np.testing.assert_array_equal(order.generation[6:], [2, 2])


def test_loops_have_generations_alone() -> None:
    order = growth_order(network([(0, 1), (1, 2), (1, 3), (2, 4), (3, 4), (4, 5)], [A] * 6))
    np.testing.assert_array_equal(order.generation, [0, 1, 1, 2, 2, 3])
    with pytest.raises(NetworkError, match="take generations"):
        order.drawn(1.0)
