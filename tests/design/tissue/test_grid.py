import numpy as np
import pytest

from design.errors import TissueError
from design.tissue import Surface, tissue_from_surface
from tests.design.geometry import oracles
from tests.design.tissue import surfaces
from tests.slower import first_of


def tissue_of(surface, **options):
    return tissue_from_surface(surface.vertices, surface.faces, **options)


@pytest.fixture(scope="module")
def hollow():
    return tissue_of(surfaces.hollow_sphere())


def random_points(tissue, count, seed=0):
    low, high = tissue.bounds
    return np.random.default_rng(seed).uniform(low - 1, high + 1, (count, 3))


@pytest.mark.slow
def test_hollow_sphere_keeps_its_cavity_outside(hollow):
    points = random_points(hollow, 20_000)
    away = np.linalg.norm(points, axis=1)
    clear = (np.abs(away - 10) > 0.1) & (np.abs(away - 6) > 0.1)
    expected = (away < 10) & (away > 6)
    np.testing.assert_array_equal(hollow.contains(points)[clear], expected[clear])


def test_distance_of_hollow_sphere_is_that_of_two_spheres(hollow):
    points = random_points(hollow, 5_000)
    away = np.linalg.norm(points, axis=1)
    expected = np.maximum(away - 10, 6 - away)
    near = np.abs(expected) < 1.0
    # Facets of 64 sides leave the sphere by 0.01 mm; the rest is the reading.
    np.testing.assert_allclose(hollow.grid.distance(points)[near], expected[near], atol=0.05)


@pytest.mark.slow
def test_torus_keeps_its_hole_outside():
    tissue = tissue_of(surfaces.torus())
    points = random_points(tissue, 20_000)
    ring = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 8, points[:, 2]) - 3
    clear = np.abs(ring) > 0.1
    np.testing.assert_array_equal(tissue.contains(points)[clear], (ring < 0)[clear])


def test_wall_of_a_third_of_a_millimetre_is_seen():
    tissue = tissue_of(surfaces.thin_box(0.3))
    assert tissue.thinnest_wall_mm == pytest.approx(0.3, abs=1e-6)
    assert tissue.grid.spacing_mm <= 0.3 / 4 + 1e-9
    points = np.array([[6.0, 6.0, z] for z in (11.5, 11.75, 11.85, 11.95, 12.1)])
    assert tissue.contains(points).tolist() == [False, True, True, True, False]
    np.testing.assert_allclose(tissue.grid.distance(points[2:3]), -0.15, atol=0.02)


def test_inside_out_mesh_is_turned():
    shape = surfaces.hollow_sphere()
    tissue = tissue_of(Surface(shape.vertices, shape.faces[:, ::-1]))
    assert tissue.volume_mm3 == pytest.approx(shape.volume_mm3)
    assert tissue.contains(np.array([[8.0, 0, 0], [0, 0, 0]])).tolist() == [True, False]


def test_overlapping_solids_count_once():
    one, two = surfaces.sphere(6.0), surfaces.sphere(6.0).translate((5.0, 0.0, 0.0))
    parts = [surfaces.surface(part) for part in (one, two)]
    vertices = np.concatenate([p.vertices for p in parts])
    faces = np.concatenate([parts[0].faces, parts[1].faces + len(parts[0].vertices)])
    tissue = tissue_from_surface(vertices, faces)
    union = surfaces.surface(one + two)
    assert tissue.volume_mm3 == pytest.approx(union.volume_mm3, rel=1e-3)
    assert tissue.contains(np.array([[2.5, 0.0, 0.0]])).all()


@pytest.mark.parametrize("bricks", first_of([2, 8]))
def test_samples_are_exact_distances(hollow, bricks):
    grid = hollow.grid.arrays
    corners = hollow.surface.vertices[hollow.surface.faces]
    rng = np.random.default_rng(5)
    a, b, c = np.nonzero(grid.brick >= 0)
    for n in rng.integers(0, len(a), bricks):
        i, j, k = rng.integers(0, 9, 3)
        p = grid.origin + grid.spacing * (8 * np.array([a[n], b[n], c[n]]) + (i, j, k))
        near = np.argsort(np.linalg.norm(corners.mean(axis=1) - p, axis=1))[:200]
        exact = min(oracles.point_triangle(p, *t) for t in corners[near])
        sample = grid.samples[grid.brick[a[n], b[n], c[n]], i, j, k]
        assert abs(sample) == pytest.approx(exact, abs=1e-5)
        assert (sample < 0) == (6 < np.linalg.norm(p) < 10)


def test_reads_are_never_deeper_than_exact_by_more_than_stated(hollow):
    points = random_points(hollow, 4_000, seed=6)
    away = np.linalg.norm(points, axis=1)
    inside = (away < 9.95) & (away > 6.05)
    exact = np.minimum(10 - away, away - 6)[inside]
    read = -hollow.grid.distance(points[inside])
    assert (read - exact).max() < hollow.grid.error_mm + 0.03


def test_wall_too_thin_for_any_grid_is_refused_with_figures():
    with pytest.raises(TissueError, match=r"walls of 0\.001 mm need a grid spacing of .* MB"):
        tissue_of(surfaces.thin_box(0.001))


@pytest.mark.slow
def test_grid_is_the_same_whatever_the_number_of_threads():
    import numba

    shape = surfaces.hollow_sphere()
    threads = numba.get_num_threads()
    many = tissue_of(shape).grid.arrays
    numba.set_num_threads(1)
    try:
        one = tissue_of(shape).grid.arrays
    finally:
        numba.set_num_threads(threads)
    assert many.samples.tobytes() == one.samples.tobytes()
    assert many.coarse.tobytes() == one.coarse.tobytes()
