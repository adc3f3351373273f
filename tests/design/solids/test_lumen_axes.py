"""Lumens found in a model without its network, against the network that it was made of."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest

from design.errors import SolidError
from design.network import VesselNetwork
from design.solids.lumen_axes import lumen_network, unfollowed_ways
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
    found = lumen_network(model, is_lumen=alone)
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
    found = lumen_network(solid(BLOCK - lumens(slanted) - lumens(blind)))
    assert found.vessel_count == 2
    # The blind one ends in half a ball.
    assert sorted(found.lengths()) == pytest.approx([2.35, 9.1], abs=0.2)
    assert sorted(found.mean_radius()) == pytest.approx([0.2, 0.3], rel=0.02)
    line, radius = found.polyline(int(found.lengths().argmax()))
    way = (line[:, :1] + 0.5) * [1.0, 0.08, 0.12]
    assert line - [-0.5, 0.8, 0.7] == pytest.approx(way, abs=0.003)
    assert radius == pytest.approx(np.full(len(radius), 0.2), rel=0.01)


def test_a_groove_a_notch_and_a_dimple_are_no_lumens() -> None:
    groove = manifold3d.Manifold.cube((10.0, 0.6, 0.6)).translate((-0.5, 1.7, 2.1))
    notch = manifold3d.Manifold.cube((3.0, 3.0, 3.0)).translate((7.0, 2.5, -0.2))
    dimple = manifold3d.Manifold.sphere(0.5, 32).translate((2.0, 1.0, 2.6))
    part = BLOCK - groove - notch - dimple
    with pytest.raises(SolidError, match="no lumen"):
        lumen_network(solid(part))
    found = lumen_network(solid(part - lumens(channel((-1, 2, 1), (10, 2, 1), 0.3))))
    assert found.vessel_count == 1
    assert found.lengths()[0] == pytest.approx(9.0, abs=0.05)
