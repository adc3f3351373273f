"""Faces that pass through one another: against every pair by exact arithmetic."""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations
from typing import Any

import numpy as np
import pytest

from design.solids import Solid, block_solid, find_crossings, lumen_solid
from design.solids.crossings import side
from tests.design.solids.networks import channels


def _exact_side(a: Any, b: Any, c: Any, d: Any) -> int:
    p, q, r = ([Fraction(x) - Fraction(y) for x, y in zip(v, d, strict=True)] for v in (a, b, c))
    det = (
        p[0] * (q[1] * r[2] - q[2] * r[1])
        - p[1] * (q[0] * r[2] - q[2] * r[0])
        + p[2] * (q[0] * r[1] - q[1] * r[0])
    )
    return (det > 0) - (det < 0)


def _pierced(p: Any, q: Any, tri: Any) -> bool:
    if _exact_side(*tri, p) * _exact_side(*tri, q) >= 0:
        return False
    turns = {_exact_side(p, q, tri[k], tri[(k + 1) % 3]) for k in range(3)}
    return turns in ({1}, {-1})


def _brute(vertices: np.ndarray, faces: np.ndarray) -> set[tuple[int, int]]:
    found = set()
    for one, two in combinations(range(len(faces)), 2):
        if set(faces[one].tolist()) == set(faces[two].tolist()):
            found.add((one, two))
        for a, b in ((one, two), (two, one)):
            for k in range(3):
                ends = {int(faces[a, k]), int(faces[a, (k + 1) % 3])}
                if ends & set(faces[b].tolist()):
                    continue
                p, q = vertices[faces[a, k]], vertices[faces[a, (k + 1) % 3]]
                if _pierced(p, q, vertices[faces[b]]):
                    found.add((one, two))
    return found


@pytest.mark.parametrize("shared", [False, True])
def test_all_faces_that_cross_are_found_and_no_others(shared: bool) -> None:
    rng = np.random.default_rng(4)
    if shared:
        vertices, faces = rng.random((14, 3)), rng.permuted(np.tile(np.arange(14), (40, 1)), axis=1)
        faces = faces[:, :3]
    else:
        middles = rng.random((60, 1, 3))
        vertices = (middles + 0.6 * (rng.random((60, 3, 3)) - 0.5)).reshape(-1, 3)
        faces = np.arange(180).reshape(-1, 3)
    expected = _brute(vertices, faces)
    found = find_crossings(vertices, faces)
    pairs = {tuple(sorted(pair)) for pair in found.crossing.tolist()}
    assert pairs <= expected
    # Each face is listed with one partner at most; together they leave no crossing unseen.
    hit = {face for pair in pairs for face in pair}
    assert len(expected) > 15
    assert all(one in hit or two in hit for one, two in expected)


def test_a_closed_surface_without_crossings_has_none() -> None:
    fork = channels([[0, 0, 0], [5, 0, 0], [9, 3, 0], [9, -3, 1]], [(0, 1), (1, 2), (1, 3)], 0.4)
    solid = lumen_solid(fork, fillet_ratio=0.5)
    found = find_crossings(solid.vertices, solid.faces)
    assert len(found.crossing) == 0
    block = block_solid((1, 2, 3))
    assert find_crossings(block.vertices, block.faces).touching == 0


def test_neighbours_folded_onto_one_another_cross() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0.3, 1, 0], [0.6, 0.5, 0], [0.5, -1, 0]])
    folded = find_crossings(vertices, np.array([[0, 1, 2], [1, 0, 3]]))
    assert folded.crossing.tolist() in ([[0, 1]], [[1, 0]])
    assert len(find_crossings(vertices, np.array([[0, 1, 2], [1, 0, 4]])).crossing) == 0


def test_faces_on_one_another_in_one_plane_touch() -> None:
    vertices = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0.2, 0.2, 0], [3, 0.5, 0], [0.5, 3, 0]])
    found = find_crossings(vertices, np.array([[0, 1, 2], [3, 4, 5]]))
    assert (len(found.crossing), found.touching) == (0, 1)
    apart = vertices + np.array([0, 0, 0] * 3 + [5, 0, 0] * 3).reshape(6, 3)
    assert find_crossings(apart, np.array([[0, 1, 2], [3, 4, 5]])).touching == 0


def test_two_bodies_pushed_into_one_another_cross() -> None:
    cube = block_solid((1, 1, 1))
    turn, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    both = Solid(
        np.concatenate([cube.vertices, cube.vertices @ turn.T + 0.5]),
        np.concatenate([cube.faces, cube.faces + 8]),
    )
    assert len(find_crossings(both.vertices, both.faces).crossing) > 0


def test_the_side_of_a_plane_is_never_wrong() -> None:
    rng = np.random.default_rng(8)
    unsure = 0
    for _ in range(300):
        a, b, c = rng.normal(size=(3, 3)).astype(np.float32).astype(float)
        weight = rng.dirichlet(np.ones(3))
        d = (weight @ np.stack([a, b, c]) + rng.choice([0.0, 1e-7]) * rng.normal(size=3)).astype(
            np.float32
        )
        found = side(a, b, c, d.astype(float))
        unsure += found == 0
        assert found in (0, _exact_side(a.tolist(), b.tolist(), c.tolist(), d.tolist()))
    assert unsure < 30
