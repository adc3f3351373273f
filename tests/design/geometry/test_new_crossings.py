"""Crossings of new triangles: those of all that concern one of them."""

from __future__ import annotations

import numpy as np
import pytest

from design.geometry.crossings import find_crossings, find_new_crossings


@pytest.mark.parametrize("share", [0.0, 0.1, 0.6, 1.0])
def test_new_crossings_are_those_of_new_triangles(share: float) -> None:
    random = np.random.default_rng(3)
    vertices = random.uniform(0, 1, (300, 3))
    faces = np.array([random.choice(300, 3, replace=False) for _ in range(400)])
    fresh = random.random(len(faces)) < share
    every = find_crossings(vertices, faces).pairs
    assert len(every) > 100
    expected = every[fresh[every].any(axis=1)]
    np.testing.assert_array_equal(find_new_crossings(vertices, faces, fresh).pairs, expected)
