import numpy as np

from benchmarks.checkers import winding_numbers
from benchmarks.checkers.containment import surface_tree, to_surface
from benchmarks.checkers.meshes import box_triangles
from tests.benchmarks.checkers.mesh_query import brute_distances, brute_windings

BOX = box_triangles(np.zeros(3), np.array([4.0, 3.0, 2.0]))


def test_distance_and_winding_of_a_box_are_known():
    points = np.array([[2.0, 1.5, 0.5], [2.0, 1.5, 3.0], [7.0, 7.0, 1.0], [5.0, 4.0, 3.0]])
    np.testing.assert_allclose(brute_distances(points, BOX), [0.5, 1.0, 5.0, np.sqrt(3.0)])
    np.testing.assert_allclose(brute_windings(points, BOX), [1.0, 0.0, 0.0, 0.0], atol=1e-12)


def test_box_tree_agrees_with_brute_force_on_random_triangles():
    rng = np.random.default_rng(0)
    triangles = rng.uniform(0, 10, (200, 1, 3)) + rng.normal(0, 1, (200, 3, 3))
    points = rng.uniform(0, 10, (50, 3))
    tree = surface_tree(triangles)
    found = to_surface(points, points, np.full(50, 99.0), tree, triangles[tree.order])
    np.testing.assert_allclose(found, brute_distances(points, triangles), atol=1e-12)


def test_winding_numbers_agree_with_brute_force():
    rng = np.random.default_rng(1)
    shifted = BOX + np.array([1.0, 1.0, 0.5])
    both = np.concatenate([BOX, shifted])
    points = rng.uniform(-1, 6, (200, 3))
    found = winding_numbers(points, both)
    np.testing.assert_array_equal(found, np.rint(brute_windings(points, both)))
    assert found.max() == 2
