"""Lumens found in a model without its network, against the network that it was made of."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest

from design.errors import SolidError
from design.network import VesselNetwork
from design.solids.lumen_axes import found_lumens, unfollowed_ways
from design.solids.topology import network_genus
from tests.registration.parts import lumens, solid

BLOCK = manifold3d.Manifold.cube((9.0, 5.0, 2.6))
FORKED = VesselNetwork.from_segments(
    np.array([(-0.5, 2.5, 1.3), (2.5, 2.5, 1.3), (4.5, 1.2, 1.1), (4.5, 3.8, 1.5),
              (6.5, 2.5, 1.3), (9.5, 2.0, 1.0)]),
    np.array([(0, 1), (1, 2), (1, 3), (2, 4), (3, 4), (4, 5)]),
    np.array([0.4, 0.25, 0.3, 0.25, 0.3, 0.35]),
    np.full(6, 4),
    np.zeros(6),
)  # fmt: skip
"""In, two ways that each bend and meet again, and out, through both faces of the block."""


def channel(start: tuple[float, ...], end: tuple[float, ...], radius: float) -> VesselNetwork:
    ends, one = np.array([start, end], dtype=float), np.array([[0, 1]])
    return VesselNetwork.from_segments(ends, one, np.array([radius]), np.array([4]), np.zeros(1))


def off_axis_mm(found: VesselNetwork, designed: VesselNetwork) -> float:
    """Return how far any point of the axes found lies beside the designed axes."""
    start, end, _, _, _ = designed.pieces()
    way = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    off = found.points[:, None] - start
    return float(np.linalg.norm(np.cross(off, way), axis=-1).min(axis=1).max())


@pytest.mark.parametrize("alone", [False, True])
def test_a_loop_and_its_forks_are_found_where_and_as_wide_as_designed(alone: bool) -> None:
    inside = lumens(FORKED)
    model = solid(inside if alone else BLOCK - inside)
    found = found_lumens(model, is_lumen=alone).network
    # The two vessels to each bend are one lumen.
    assert (found.vessel_count, len(found.nodes)) == (4, 4)
    assert off_axis_mm(found, FORKED) < 0.03
    assert sorted(found.mean_radius()) == pytest.approx([0.25, 0.3, 0.35, 0.4], rel=0.02)
    if not alone:
        assert unfollowed_ways(model, found) == 0


def test_a_slanted_channel_reaches_both_faces_and_a_blind_one_its_end() -> None:
    slanted, blind = (
        channel((-0.5, 0.8, 0.7), (9.5, 1.6, 1.9), 0.2),
        channel((4.5, 5.5, 1.3), (4.5, 2.8, 1.3), 0.3),
    )
    found = found_lumens(solid(BLOCK - lumens(slanted) - lumens(blind))).network
    assert found.vessel_count == 2
    # The blind one ends in half a ball.
    assert sorted(found.lengths()) == pytest.approx([2.35, 9.1], abs=0.2)
    assert sorted(found.mean_radius()) == pytest.approx([0.2, 0.3], rel=0.02)
    line, radius = found.polyline(int(found.lengths().argmax()))
    way = (line[:, :1] + 0.5) * [1.0, 0.08, 0.12]
    assert line - [-0.5, 0.8, 0.7] == pytest.approx(way, abs=0.003)
    assert radius == pytest.approx(np.full(len(radius), 0.2), rel=0.01)


def test_axes_go_on_to_slanted_faces_and_the_joints_of_acute_forks() -> None:
    places = np.array([(-0.5, 2.5, 1.3), (2.2, 2.5, 1.3), (9.5, 0.7, 1.5), (9.5, 4.0, 1.3),
                       (1.0, 4.2, -0.4), (3.54, 4.2, 3.0)])  # fmt: skip
    net = VesselNetwork.from_segments(places, np.array([(0, 1), (1, 2), (1, 3), (4, 5)]),
                                      np.array([0.4, 0.3, 0.26, 0.25]), np.full(4, 4),
                                      np.zeros(4))  # fmt: skip
    found = found_lumens(solid(BLOCK - lumens(net)))
    assert (found.network.vessel_count, found.left, found.stretches) == (4, 0.0, ((),) * 4)
    fork = found.network.nodes[found.network.degree() == 3]
    assert fork[0] == pytest.approx(places[1], abs=0.03)
    steep = found.network.nodes[np.argsort(found.network.nodes[:, 2])[[0, -1]]]
    assert steep == pytest.approx(np.array([(1.3, 4.2, 0.0), (3.24, 4.2, 2.6)]), abs=0.03)


def test_what_no_vessel_follows_is_told_and_a_bubble_is_no_lumen() -> None:
    bubble = manifold3d.Manifold.sphere(0.6, 64).translate((4.5, 1.2, 1.3))
    with pytest.raises(SolidError, match="no lumen"):
        found_lumens(solid(BLOCK - bubble))
    found = found_lumens(solid(BLOCK - bubble - lumens(channel((-1, 3, 1.3), (10, 3, 1.3), 0.3))))
    assert found.network.vessel_count == 1
    share = 0.6**3 * 4 / 3 / (0.6**3 * 4 / 3 + 9 * 0.3**2)
    assert found.left == pytest.approx(share, rel=0.1)
    assert np.abs(found.left_at - [4.5, 1.2, 1.3]).max() < 0.6
    flat = manifold3d.Manifold.cube((11.0, 2.4, 0.5)).translate((-1.0, 1.2, 1.0))
    found = found_lumens(solid(BLOCK - flat))
    lengths = found.network.lengths()
    unsure = [sum(b - a for a, b in one) for one in found.stretches]
    assert sum(unsure) > 0.8 * lengths.sum()


def test_a_groove_a_notch_and_a_dimple_are_no_lumens() -> None:
    groove = manifold3d.Manifold.cube((10.0, 0.6, 0.6)).translate((-0.5, 1.7, 2.1))
    notch = manifold3d.Manifold.cube((3.0, 3.0, 3.0)).translate((7.0, 2.5, -0.2))
    dimple = manifold3d.Manifold.sphere(0.5, 32).translate((2.0, 1.0, 2.6))
    part = BLOCK - groove - notch - dimple
    with pytest.raises(SolidError, match="no lumen"):
        found_lumens(solid(part))
    found = found_lumens(solid(part - lumens(channel((-1, 2, 1), (10, 2, 1), 0.3)))).network
    assert found.vessel_count == 1
    assert found.lengths()[0] == pytest.approx(9.0, abs=0.05)


def test_a_closed_ring_and_lumens_a_wall_apart_are_found() -> None:
    turn = np.linspace(0, 2 * np.pi, 33)[:-1]
    ring = VesselNetwork.from_segments(
        np.column_stack([3 + 1.2 * np.cos(turn), 2.5 + 1.2 * np.sin(turn), np.full(32, 1.3)]),
        np.column_stack([np.arange(32), np.roll(np.arange(32), -1)]),
        np.full(32, 0.3), np.full(32, 4), np.zeros(32),
    )  # fmt: skip
    one = channel((7.0, -0.5, 1.3), (7.0, 5.5, 1.3), 0.3)
    two = channel((7.65, -0.5, 1.3), (7.65, 5.5, 1.3), 0.3)
    found = found_lumens(solid(BLOCK - lumens(ring) - lumens(one) - lumens(two)))
    assert sorted(found.network.lengths()) == pytest.approx([5.0, 5.0, 2.4 * np.pi], abs=0.1)
    assert (found.left, found.stretches) == (0.0, ((),) * 3)
    assert network_genus(found.network) == 1
