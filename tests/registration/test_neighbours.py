"""Share of a vessel's designed wall not shared with neighbours."""

import numpy as np

from design.network import VesselNetwork
from registration.measuring.gauging.trace import Neighbours


def _network(nodes: list[list[float]], ends: list[list[int]], radius: list[float]) -> VesselNetwork:
    count = len(ends)
    return VesselNetwork.from_segments(
        np.array(nodes, float),
        np.array(ends),
        np.array(radius),
        np.zeros(count, int),
        np.zeros(count, int),
    )


def _free(network: VesselNetwork, vessel: int, at: list[float]) -> float:
    tangent = np.diff(network.polyline(vessel)[0], axis=0)
    tangent /= np.linalg.norm(tangent)
    radius = network.polyline(vessel)[1][:1]
    return float(Neighbours(network).free_wall(vessel, np.array([at]), tangent, radius)[0])


TEE = _network(
    [[0, 0, 0], [10, 0, 0], [20, 0, 0], [10, 5, 0]], [[0, 1], [1, 2], [1, 3]], [1, 1, 0.2]
)


def test_wall_is_its_own_away_from_the_junction() -> None:
    assert _free(TEE, 2, [10, 3, 0]) == 1.0
    assert _free(TEE, 0, [5, 0, 0]) == 1.0


def test_branch_inside_its_parent_has_no_wall() -> None:
    assert _free(TEE, 2, [10, 0.5, 0]) == 0.0


def test_wall_between_is_shared() -> None:
    acute = _network([[0, 0, 0], [9, 0, 0], [9, 1.2, 0]], [[0, 1], [0, 2]], [0.5, 0.5])
    assert 0.4 < _free(acute, 1, [4.5, 0.6, 0]) < 0.9


def test_lone_vessel_owns_all_of_its_wall() -> None:
    alone = _network([[0, 0, 0], [0, 0, 5]], [[0, 1]], [0.5])
    assert _free(alone, 0, [0, 0, 0.1]) == 1.0


def test_neighbour_beyond_a_short_vessel_counts() -> None:
    chain = _network(
        [[0, 0, 0], [5, 0, 0], [5.2, 0, 0], [5.2, 4, 0]],
        [[0, 1], [1, 2], [2, 3]],
        [0.3, 0.3, 1.0],
    )
    assert _free(chain, 0, [4.9, 0, 0]) == 0.0
