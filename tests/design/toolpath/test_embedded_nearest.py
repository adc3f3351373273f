"""Nearest place of a vessel to another vessel, along its centreline."""

from __future__ import annotations

import numpy as np
import pytest

from design.toolpath.embedded.elements import elements_of, nearest_along
from tests.design.toolpath.shapes import polylines

BEND = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])


@pytest.mark.parametrize(
    ("place", "along"),
    [
        ([0.4, 0.1, 0.0], 0.4),
        ([1.2, 0.0, 0.0], 1.0),  # straight on at the bend: no further along
        ([1.1, 0.3, 0.2], 1.3),
        ([-0.2, 0.1, 0.0], -0.2),
        ([0.9, 1.5, 0.0], 2.5),
    ],
)
def test_way_along_a_bent_vessel_counts_on_past_its_ends(place: list[float], along: float) -> None:
    elements = elements_of(polylines([BEND], 0.1), 0.15)
    assert nearest_along(elements, 0, np.array(place)) == pytest.approx(along, abs=1e-9)
