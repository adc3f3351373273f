import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.errors import NetworkError
from design.network import VesselKind, VesselNetwork
from design.vasculature import check_network, collisions
from tests.design.vasculature import oracles
from tests.slower import examples


def straight(*ends, radius=0.5):
    """Vessels between points given as pairs; equal points are one node."""
    points = [tuple(p) for pair in ends for p in pair]
    nodes = list(dict.fromkeys(points))
    number = [nodes.index(p) for p in points]
    count = len(ends)
    return VesselNetwork.from_segments(
        np.array(nodes, dtype=float),
        np.array(number).reshape(-1, 2),
        np.broadcast_to(np.asarray(radius, dtype=float), count),
        np.full(count, int(VesselKind.CHANNEL)),
        np.zeros(count, dtype=np.int64),
    )


def test_crossing_vessels_are_refused_by_name_place_and_gap():
    network = straight(((0, 0, 0), (10, 0, 0)), ((5, -5, 0.4), (5, 5, 0.4)))
    with pytest.raises(
        NetworkError, match=r"vessels 0 and 1 overlap by 0\.6 mm at \(5, 0, 0\.2\)"
    ) as told:
        check_network(network)
    assert "lower the clearance" not in str(told.value)
    assert "overlaps: tell" in str(told.value)


def test_vessels_nearer_than_the_clearance_are_refused():
    network = straight(((0, 0, 0), (10, 0, 0)), ((0, 2, 0), (10, 2, 0)))
    check_network(network, clearance_mm=0.99)
    with pytest.raises(NetworkError, match="are only 1 mm apart"):
        check_network(network, clearance_mm=1.01)


def test_a_bent_vessel_is_checked_against_itself():
    points = np.array([[0, 0, 0], [9, 0, 0], [9, 3, 0], [5, 3, 0], [5, 0.8, 0]], dtype=float)
    network = VesselNetwork(
        nodes=points[[0, -1]],
        vessel_nodes=np.array([[0, 1]]),
        kind=np.array([4]),
        tree=np.array([0]),
        offset=np.array([0, 5]),
        points=points,
        radius=np.full(5, 0.5),
    )
    with pytest.raises(NetworkError, match="vessels 0 and 0 overlap"):
        check_network(network)


def test_a_vessel_without_length_is_refused():
    network = VesselNetwork.from_segments(
        np.array([[0.0, 0, 0], [0, 0, 0]]),
        np.array([[0, 1]]),
        np.array([0.5]),
        np.array([4]),
        np.array([0]),
    )
    with pytest.raises(NetworkError, match="vessel 0 has no length"):
        check_network(network)


@settings(deadline=None, max_examples=examples(60))
@given(
    st.integers(0, 10_000),
    st.integers(2, 40),
    st.sampled_from([(0.0, 0.0), (0.3, 0.0), (0.0, 0.5)]),
)
def test_collisions_agree_with_all_pairs(seed, count, clearance):
    rng = np.random.default_rng(seed)
    nodes = rng.uniform(0, 10, (count, 3))
    ends = {(int(rng.integers(0, n)), n) for n in range(1, count)}
    network = straight(
        *[(nodes[a], nodes[b]) for a, b in sorted(ends)], radius=rng.uniform(0.05, 0.8, len(ends))
    )
    found = collisions(network, *clearance)
    colliding, joints = oracles.colliding_pairs(network, *clearance)
    assert set(map(tuple, found.pieces.tolist())) == colliding
    assert set(map(tuple, found.joint_pieces.tolist())) == joints


def test_a_hairpin_with_a_long_way_around_collides():
    hairpin = [(0, 0, 0), (9, 0, 0), (9, 3, 0), (5, 3, 0), (5, 0.8, 0)]
    found = collisions(straight(*itertools.pairwise(hairpin)))
    assert found.vessels.tolist() == [[0, 3]]
