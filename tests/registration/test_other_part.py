"""Scans of a part with defects and of other parts, by where their hollows are."""

from __future__ import annotations

from collections.abc import Callable

import manifold3d
import numpy as np
import pytest

from design.network import VesselNetwork
from registration.alignment.distance import ModelSurface
from registration.measuring.topology import agreement
from registration.measuring.topology.overlap import Agreement
from tests.registration.parts import lumens, solid
from tests.registration.phantom import BLOCK, IDENTITY, block, ladder, ladder_construct

Filled = Callable[[np.ndarray], np.ndarray]
OTHER = VesselNetwork.from_segments(
    np.array([(0.0, 0.7, 0.6), (9.0, 3.7, 1.9), (0.0, 3.8, 1.3), (9.0, 0.7, 1.3)]),
    np.array([[0, 1], [2, 3]]), np.array([0.3, 0.35]), np.full(2, 4), np.arange(2),
)  # fmt: skip


def half(points: np.ndarray) -> np.ndarray:
    """Gel all over the half with the channels' ends: five of eight vessels aren't there."""
    return points[..., 0] * -1.0 + 3.0


def bubbles(points: np.ndarray) -> np.ndarray:
    """Six bubbles of 0.5 mm in the gel."""
    middles = [(x, y, 0.5) for x in (2.0, 4.5, 7.0) for y in (0.5, 3.9)]
    return np.min([np.linalg.norm(points - one, axis=-1) - 0.25 for one in middles], axis=0)


@pytest.mark.parametrize("filled", [None, half])
@pytest.mark.parametrize("extra", [None, bubbles])
def test_a_part_with_missing_vessels_and_bubbles_is_that_part(
    filled: Filled | None, extra: Filled | None
) -> None:
    segmentation = block(extra=extra, filled=filled)
    surface = ModelSurface.of(ladder_construct())
    found = agreement(surface, ladder(), segmentation, IDENTITY, False)
    assert not found.other_part
    assert found.foreign_share < 0.1


def test_a_part_with_other_channels_in_the_same_block_is_another() -> None:
    model = solid(manifold3d.Manifold.cube(tuple(BLOCK)) - lumens(OTHER))
    found = agreement(ModelSurface.of(model), OTHER, block(), IDENTITY, False)
    assert found.other_part
    assert found.foreign_share > 0.5
    assert found.designed_open < 0.4


def test_a_fifth_of_the_hollow_elsewhere_is_another_part_where_few_lumens_are_open() -> None:
    assert Agreement(0.18, 0.35, 0.8).other_part
    assert not Agreement(0.18, 0.9, 0.8).other_part
