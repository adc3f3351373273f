"""Network class: derived quantities, and refusal of invalid input."""

import numpy as np
import pytest

from design.errors import NetworkError
from design.network import VesselKind, VesselNetwork

NODES = np.array([[0.0, 0, 0], [3, 0, 0], [3, 4, 0], [6, 0, 0]])
ENDS = np.array([[0, 1], [1, 2], [1, 3]])


def network(radius: object = (1.0, 0.5, 0.5), nodes: object = NODES) -> VesselNetwork:
    kinds = np.full(3, VesselKind.ARTERY)
    return VesselNetwork.from_segments(
        np.array(nodes), ENDS, np.array(radius), kinds, np.zeros(3, dtype=int)
    )


def test_lengths_and_radii_are_those_of_the_polylines() -> None:
    made = network()
    np.testing.assert_allclose(made.lengths(), [3, 4, 3])
    np.testing.assert_allclose(made.mean_radius(), [1, 0.5, 0.5])


def test_inlets_and_outlets_follow_the_designed_direction() -> None:
    made = network()
    assert made.inlets().tolist() == [0]
    assert made.outlets().tolist() == [2, 3]
    assert made.degree().tolist() == [1, 3, 1, 1]


def test_moving_keeps_everything_but_the_place() -> None:
    moved = network().moved(np.array([1.0, 2, 3]))
    np.testing.assert_allclose(moved.nodes, NODES + [1, 2, 3])
    np.testing.assert_allclose(moved.lengths(), network().lengths())


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_impossible_position_is_refused_with_its_vessel(bad: float) -> None:
    nodes = NODES.copy()
    nodes[3, 1] = bad
    with pytest.raises(NetworkError, match="vessel 2: position"):
        network(nodes=nodes)


@pytest.mark.parametrize("bad", [0.0, -1.0])
def test_radius_must_be_positive(bad: float) -> None:
    with pytest.raises(NetworkError, match="vessel 1: radius"):
        network(radius=(1.0, bad, 0.5))
