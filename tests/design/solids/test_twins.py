"""Half-edges paired, fans and shells counted: against sorting and scipy's graphs."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from design.solids import block_solid
from design.solids.topology import (
    corner_fans,
    edge_faults,
    is_closed,
    pair_half_edges,
    surface_genus,
)


@cache
def cube() -> np.ndarray:
    return block_solid((1, 1, 1)).faces.astype(np.int64)


def _random_faces(seed: int) -> np.ndarray:
    """Cubes of which some corners are merged, and some faces dropped, turned or doubled."""
    random = np.random.default_rng(seed)
    faces = np.concatenate([cube() + 8 * k for k in range(4)])
    merged = np.arange(32)
    merged[random.integers(0, 32, 3)] = random.integers(0, 32, 3)
    faces = merged[faces]
    for _ in range(random.integers(0, 3)):
        k = int(random.integers(len(faces)))
        change = random.integers(3)
        if change == 0:
            faces = np.delete(faces, k, axis=0)
        elif change == 1:
            faces[k] = faces[k, ::-1]
        else:
            faces = np.concatenate([faces, faces[k : k + 1]])
    return faces


@pytest.mark.parametrize("seed", range(40))
def test_twins_are_the_only_opposite_sides_of_an_edge(seed: int) -> None:
    faces = _random_faces(seed)
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    twin = pair_half_edges(faces)
    for h in range(len(tail)):
        same = {tail[h], head[h]}
        sides = [g for g in range(len(tail)) if {tail[g], head[g]} == same]
        opposite = [g for g in sides if tail[g] == head[h] and head[g] == tail[h] and g != h]
        whole = len(sides) == 2 and len(opposite) == 1 and tail[h] != head[h]
        expected = opposite[0] if whole else -1
        assert twin[h] == expected
    assert is_closed(faces) == bool((twin >= 0).all())
    assert bool(edge_faults(faces)) == bool((twin < 0).any())


def test_fans_and_shells_of_cubes_that_touch_in_a_corner() -> None:
    faces = np.concatenate([cube(), cube() + 8, cube() + 16])
    faces[faces == 8] = 0
    assert surface_genus(faces) == (0, 3)
    fan = corner_fans(faces)
    twin = pair_half_edges(faces)
    after = np.roll(np.arange(faces.size).reshape(-1, 3), -1, axis=1).ravel()
    joined = coo_array((np.ones(faces.size), (np.arange(faces.size), after[twin])))
    count, parts = connected_components(joined, directed=False)
    assert fan.max() + 1 == count == 24
    np.testing.assert_array_equal(fan.ravel(), parts)


def test_nothing_is_closed() -> None:
    assert is_closed(np.empty((0, 3), np.int64))
