import numpy as np
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
from tests.design.geometry import oracles

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
