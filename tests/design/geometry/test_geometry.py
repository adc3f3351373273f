"""Self-intersections of triangle meshes, against every pair by exact arithmetic."""

from fractions import Fraction
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from design.geometry import (
    build_triangle_tree,
    gather_within,
    nearest_distances,
    point_segment,
    point_triangle_squared,
    segment_segment,
)
from design.geometry.crossings import plane_side
from design.solids import block_solid, find_crossings, lumen_solid
from tests.design.geometry import oracles
from tests.design.solids.networks import channels
from tests.slower import first_of


def _exact_side(a: Any, b: Any, c: Any, d: Any) -> int:
    p, q, r = ([Fraction(x) - Fraction(y) for x, y in zip(v, d, strict=True)] for v in (a, b, c))
    det = (
        p[0] * (q[1] * r[2] - q[2] * r[1])
        - p[1] * (q[0] * r[2] - q[2] * r[0])
        + p[2] * (q[0] * r[1] - q[1] * r[0])
    )
    return (det > 0) - (det < 0)


def _minus(a: Any, b: Any) -> list[Any]:
    return [x - y for x, y in zip(a, b, strict=True)]


def _cross(a: Any, b: Any) -> list[Any]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _dot(a: Any, b: Any) -> Any:
    return sum(x * y for x, y in zip(a, b, strict=True))


def _clipped(polygon: list[Any], normal: Any, through: Any) -> list[Any]:
    """What of a convex polygon is on the inner side of a plane, or on it."""
    kept: list[Any] = []
    for here, after in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        at, to = _dot(normal, _minus(here, through)), _dot(normal, _minus(after, through))
        if at >= 0:
            kept.append(here)
        if at * to < 0:
            share = at / (at - to)
            kept.append([x + share * (y - x) for x, y in zip(here, after, strict=True)])
    return kept


def _common(one: Any, two: Any) -> list[Any]:
    """Corners of what two closed triangles have in common, by clipping one with the other."""
    normal = _cross(_minus(two[1], two[0]), _minus(two[2], two[0]))
    polygon = _clipped(_clipped(one, normal, two[0]), [-x for x in normal], two[0])
    for k in range(3):
        inward = _cross(normal, _minus(two[(k + 1) % 3], two[k]))
        polygon = _clipped(polygon, inward, two[k])
    return polygon


def _brute(vertices: np.ndarray, faces: np.ndarray) -> set[tuple[int, int]]:
    exact = [[Fraction(float(x)) for x in place] for place in vertices]
    found = set()
    low, high = vertices[faces].min(axis=1), vertices[faces].max(axis=1)
    for one, two in combinations(range(len(faces)), 2):
        if (low[one] > high[two]).any() or (low[two] > high[one]).any():
            continue
        mine, its = faces[one].tolist(), faces[two].tolist()
        both = [exact[v] for v in mine if v in its]
        for point in _common([exact[v] for v in mine], [exact[v] for v in its]):
            known = point in both
            if len(both) == 2:
                along = _cross(_minus(both[1], both[0]), _minus(point, both[0]))
                known = not any(along)
            if not known:
                found.add((one, two))
    return found


def _soup(rng: np.random.Generator, kind: str) -> tuple[np.ndarray, np.ndarray]:
    if kind == "apart":
        middles = rng.random((60, 1, 3))
        vertices = (middles + 0.6 * (rng.random((60, 3, 3)) - 0.5)).reshape(-1, 3)
        return vertices, np.arange(180).reshape(-1, 3)
    # On a coarse grid nearly every meeting is of corners, edges or faces in one plane.
    vertices = rng.permutation(np.stack(np.meshgrid(*3 * [np.arange(3.0)]), axis=-1).reshape(-1, 3))
    if kind == "shared":
        vertices = rng.random((14, 3))
    faces = np.array([rng.permutation(len(vertices))[:3] for _ in range(60)])
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return vertices, faces[np.any(np.cross(b - a, c - a), axis=1)]


@pytest.mark.parametrize("kind", first_of(["shared", "apart", "grid"], 2))
@pytest.mark.parametrize("seed", first_of(range(3)))
def test_all_faces_that_meet_are_found_and_no_others(kind: str, seed: int) -> None:
    vertices, faces = _soup(np.random.default_rng(seed), kind)
    faces = np.unique(np.sort(faces, axis=1), axis=0)
    found = find_crossings(vertices, faces)
    expected = _brute(vertices, faces)
    assert len(expected) > 15
    assert {(one, two) for one, two in found.pairs.tolist()} == expected
    assert found.faces.tolist() == sorted({face for pair in expected for face in pair})


def test_a_closed_surface_without_crossings_has_none() -> None:
    fork = channels([[0, 0, 0], [5, 0, 0], [9, 3, 0], [9, -3, 1]], [(0, 1), (1, 2), (1, 3)], 0.4)
    solid = lumen_solid(fork, fillet_ratio=0.5)
    found = find_crossings(solid.vertices, solid.faces)
    assert len(found.pairs) == 0
    block = block_solid((1, 2, 3))
    assert len(find_crossings(block.vertices, block.faces).pairs) == 0


def test_the_side_of_a_plane_is_never_wrong() -> None:
    rng = np.random.default_rng(8)
    unsure = 0
    for _ in range(300):
        a, b, c = rng.normal(size=(3, 3)).astype(np.float32).astype(float)
        weight = rng.dirichlet(np.ones(3))
        d = (weight @ np.stack([a, b, c]) + rng.choice([0.0, 1e-7]) * rng.normal(size=3)).astype(
            np.float32
        )
        found = plane_side(a, b, c, d.astype(float))
        unsure += found == 0
        assert found in (0, _exact_side(a.tolist(), b.tolist(), c.tolist(), d.tolist()))
    assert unsure < 30


coordinate = st.integers(-8, 8).map(lambda n: n / 2)
points = lambda n: arrays(np.float64, (n, 3), elements=coordinate)  # noqa: E731


@settings(deadline=None)
@given(points(3))
def test_point_segment_agrees_with_many_samples(p):
    distance, where = point_segment(*p[0], *p[1], *p[2])
    assert 0 <= where <= 1
    assert abs(np.linalg.norm(p[1] + where * (p[2] - p[1]) - p[0]) - distance) < 1e-12
    assert abs(distance - oracles.point_segment(*p)) < 1e-3


@settings(deadline=None)
@given(points(4))
def test_segment_segment_agrees_with_algebra(p):
    distance, s, t = segment_segment(*p[0], *p[1], *p[2], *p[3])
    here = p[0] + s * (p[1] - p[0])
    there = p[2] + t * (p[3] - p[2])
    assert 0 <= s <= 1
    assert 0 <= t <= 1
    assert abs(np.linalg.norm(here - there) - distance) < 1e-9
    assert abs(distance - oracles.segment_segment(*p)) < 1e-7


@settings(deadline=None)
@given(points(4))
def test_point_triangle_agrees_with_plane_and_edges(p):
    squared = point_triangle_squared(*p[0], p[1:].ravel())
    assert abs(np.sqrt(squared) - oracles.point_triangle(*p)) < 1e-9


def test_tree_finds_the_nearest_of_random_triangles():
    rng = np.random.default_rng(3)
    vertices = rng.uniform(-1, 1, (90, 3))
    faces = rng.permutation(90).reshape(30, 3).astype(np.int32)
    tree = build_triangle_tree(vertices, faces)
    query = rng.uniform(-2, 2, (50, 3))
    expected = [min(oracles.point_triangle(q, *vertices[f]) for f in faces) for q in query]
    np.testing.assert_allclose(nearest_distances(tree, query), expected, atol=1e-12)


def test_tree_gathers_exactly_what_is_within_a_radius():
    rng = np.random.default_rng(4)
    vertices = rng.uniform(-1, 1, (300, 3))
    faces = rng.permutation(300).reshape(100, 3).astype(np.int32)
    tree = build_triangle_tree(vertices, faces)
    found = np.empty(100, np.int32)
    for q in rng.uniform(-1, 1, (20, 3)):
        size = gather_within(tree, *q, 0.5, found)
        expected = {
            n for n, f in enumerate(faces) if oracles.point_triangle(q, *vertices[f]) <= 0.5
        }
        assert set(tree.face[found[:size]].tolist()) == expected
