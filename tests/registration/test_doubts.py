"""Wording of pose uncertainty."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest

from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.alignment.rivals import describe
from registration.notes import unlisted_notes
from tests.registration.parts import solid


@pytest.mark.parametrize("whole", [True, False])
def test_a_missing_hole_is_amid_what_was_scanned(whole: bool) -> None:
    # A hole beside the middle, which the print lacks; or the scan ends before it.
    block = manifold3d.Manifold.cube((8.0, 8.0, 3.0))
    hole = manifold3d.Manifold.cube((0.6, 0.6, 0.6)).translate((5.5, 4.0, 1.2))
    surface = ModelSurface.of(solid(block - hole))
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 1, (4000, 3)) * (8.0, 8.0, 3.0)
    side = rng.integers(0, 3, 4000)
    high = rng.random(4000) < 0.5
    ends = np.array([8.0, 8.0, 3.0])
    points[np.arange(4000), side] = np.where(high, ends[side], 0.0)
    if not whole:
        points = points[points[:, 0] < 4.0]
    best = Fit(np.eye(3), np.zeros(3), np.ones(3), ends / 2)
    turned = np.diag([-1.0, -1.0, 1.0])
    other = Fit(turned, np.array([8.0, 8.0, 0.0]), np.ones(3), ends / 2)
    found = describe(surface, points, best, other, 1.1, False)
    assert found.amid == whole


def test_ways_that_rest_on_a_doubtful_pose_are_counted_and_not_listed() -> None:
    assert unlisted_notes(0) == []
    (note,) = unlisted_notes(28)
    assert note.startswith(
        "At this pose 28 places look like leaks or bridges. They aren't findings"
    )
