from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from benchmarks.checkers.containment import surface_tree, to_surface, winding_numbers
from design.errors import TissueError
from design.geometry import build_triangle_tree
from design.geometry.surface_distances import segment_distance, segment_triangle
from design.tissue import (
    BlockZone,
    SpacingRule,
    Surface,
    block,
    carve,
    load_tissue,
    tissue_from_surface,
)
from design.tissue.grid import depth_bounds, winding_number
from tests.design.tissue import surfaces
from tests.design.tissue.kept import kept_tissue


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


def test_overlapping_solids_count_once():
    one, two = surfaces.sphere(6.0), surfaces.sphere(6.0).translate((5.0, 0.0, 0.0))
    parts = [surfaces.surface(part) for part in (one, two)]
    vertices = np.concatenate([p.vertices for p in parts])
    faces = np.concatenate([parts[0].faces, parts[1].faces + len(parts[0].vertices)])
    tissue = tissue_from_surface(vertices, faces)
    union = surfaces.surface(one + two)
    assert tissue.volume_mm3 == pytest.approx(union.volume_mm3, rel=1e-3)
    assert tissue.contains(np.array([[2.5, 0.0, 0.0]])).all()


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


def wedge():
    """A block that runs out to nothing on one side."""
    shape = block((20.0, 20.0, 20.0))
    vertices = shape.vertices.copy()
    vertices[:, 2] *= np.where(vertices[:, 0] > 0, 0.01, 1.0)
    return surfaces.Surface(vertices, shape.faces)


def test_few_thin_walls_beyond_the_limit_are_noted_and_kept_exactly():
    shape = wedge()
    rule = SpacingRule(bricks=500, bricks_at_most=2000)
    tissue = tissue_from_surface(shape.vertices, shape.faces, rule=rule)
    assert len(tissue.notes) == 1
    assert "few walls, the thinnest" in tissue.notes[0]
    corners = tissue.surface.vertices[tissue.surface.faces]
    rng = np.random.default_rng(0)
    start = rng.uniform([10, 0, 0], [20, 20, 4], (20_000, 3))
    end = start + rng.normal(0, 0.3, start.shape)
    radius = rng.uniform(0.01, 0.2, len(start))
    tree = surface_tree(corners)
    away = to_surface(start, end, radius, tree, corners[tree.order])
    expected = (away >= radius) & (winding_numbers(end, corners, tree) > 0)
    assert expected.any()
    np.testing.assert_array_equal(tissue.grid.capsule_inside(start, end, radius), expected)


def test_many_thin_walls_beyond_the_limit_are_refused():
    rule = SpacingRule(bricks=500, bricks_at_most=600)
    shape = surfaces.thin_box(0.05)
    with pytest.raises(TissueError, match=r"walls of 0\.05 mm need a grid spacing of 0\.0125 mm"):
        tissue_from_surface(shape.vertices, shape.faces, rule=rule)


@pytest.mark.slow
def test_piece_cut_at_a_slant_is_prepared():
    shape, _ = carve(surfaces.hollow_sphere(), (), [BlockZone((-9, -9, 8.5), (9, 9, 12))])
    assert tissue_from_surface(shape.vertices, shape.faces).volume_mm3 > 0


SHARED = Path(__file__).parents[4] / "shared" / "data"


@pytest.fixture(scope="module")
def slit():
    shape = surfaces.slit_block()
    # The slit is open space, not a thin wall: no finer grid is asked for.
    return kept_tissue(shape, spacing_mm=0.3)


def capsules_near(tissue, count, seed=0):
    """Short capsules around points scattered about the surface."""
    rng = np.random.default_rng(seed)
    corners = tissue.surface.vertices[tissue.surface.faces]
    size = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    face = rng.choice(len(corners), count, p=size / size.sum())
    weight = rng.dirichlet(np.ones(3), count)
    middle = np.einsum("ij,ijk->ik", weight, corners[face])
    h = tissue.grid.spacing_mm
    start = middle + rng.normal(0, h, middle.shape)
    end = start + rng.normal(0, h, middle.shape)
    return start, end, rng.uniform(0.01, 0.5, count) * h


def judged(tissue, start, end, radius):
    """Whether each capsule is inside by an independent checker."""
    corners = tissue.surface.vertices[tissue.surface.faces]
    tree = surface_tree(corners)
    away = to_surface(start, end, radius, tree, corners[tree.order])
    return (away >= radius) & (winding_numbers(end, corners, tree) > 0)


def test_capsules_are_judged_exactly_where_a_slit_is_thinner_than_a_cell(slit):
    assert slit.grid.spacing_mm > 0.05
    start, end, radius = capsules_near(slit, 8_000)
    expected = judged(slit, start, end, radius)
    assert expected.any()
    assert not expected.all()
    np.testing.assert_array_equal(slit.grid.capsule_inside(start, end, radius), expected)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param("biventricle_svv.stl", marks=pytest.mark.slow), "gyrus_patch_fsaverage5.stl"],
)
def test_capsules_are_judged_exactly_in_real_tissue(name):
    if not (SHARED / name).is_file():
        pytest.skip("no shared data beside the repository")
    tissue = load_tissue(SHARED / name, "mm")
    start, end, radius = capsules_near(tissue, 50_000)
    expected = judged(tissue, start, end, radius)
    np.testing.assert_array_equal(tissue.grid.capsule_inside(start, end, radius), expected)


def test_bounds_of_depth_hold_everywhere(slit):
    rng = np.random.default_rng(3)
    near = capsules_near(slit, 1_500)[0]
    points = np.concatenate([near, rng.uniform(-2, 14, (1_500, 3))])
    corners = slit.surface.vertices[slit.surface.faces]
    tree = surface_tree(corners)
    away = to_surface(points, points, np.full(len(points), 30.0), tree, corners[tree.order])
    depth = np.where(winding_numbers(points, corners, tree) > 0, away, -away)
    bounds = np.array([depth_bounds(slit.grid.arrays, *p) for p in points])
    assert (bounds[:, 0] <= depth).all()
    assert (depth <= bounds[:, 1]).all()
    # And they say something: no wider than a cell's diagonal allows.
    width = np.ptp(bounds[: len(near)], axis=1)
    assert (width[np.isfinite(width)] < 2 * slit.grid.spacing_mm).all()


def test_winding_number_agrees_with_a_checker(slit):
    points = np.concatenate(list(capsules_near(slit, 1_000)[:2]))
    tree = build_triangle_tree(slit.surface.vertices, slit.surface.faces)
    mine = [winding_number(tree, *p) for p in points]
    np.testing.assert_array_equal(
        mine, winding_numbers(points, slit.surface.vertices[slit.surface.faces])
    )
    shapes = [surfaces.surface(surfaces.sphere(r)) for r in (6.0, 4.0)]  # overlapping solids
    vertices = np.concatenate([s.vertices for s in shapes])
    faces = np.concatenate([shapes[0].faces, shapes[1].faces + len(shapes[0].vertices)])
    tree = build_triangle_tree(vertices, faces)
    assert [winding_number(tree, x, 0.0, 0.0) for x in (0.0, 5.0, 7.0, -5.0)] == [2, 1, 0, 1]


#: Two corners that are one; three; and three in a line.
_NO_AREA = [[0.0] * 6 + [0, 1, 1], [0.0] * 9, [0.0, 0, 0, 0.1, 0.3, 0.7, 0.2, 0.6, 1.4]]


@given(st.lists(st.floats(-1, 1, width=32), min_size=15, max_size=15))
@example([0, 0, 1, 0, 0, 0, *_NO_AREA[0]])
@example([1, 0, 1, 1, 0, 0, *_NO_AREA[0][3:], 0, 0, 0])
@example([0.5, 0.5, 1, 0, 0.25, 0, *_NO_AREA[1]])
@example([0.5, 0.5, 1, 0, 0.25, 0, *_NO_AREA[2]])
@example([1, 0, 0, 0, 1 / 3, -1, -1, 0, 0, 1e-8, 0, 0, 0, 1e-8, 0])
@example([0.2, 0.2, -1.0, 0.3, 0.3, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0])
def test_segment_triangle_distance_is_the_least_over_their_points(numbers):
    a, b, corners = np.array(numbers[:3]), np.array(numbers[3:6]), np.reshape(numbers[6:], (3, 3))
    s = np.linspace(0, 1, 33)
    u, v = (x[np.add.outer(s, s) <= 1 + 1e-12] for x in np.meshgrid(s, s))
    on = corners[0] + np.outer(u, corners[1] - corners[0]) + np.outer(v, corners[2] - corners[0])
    along = a + np.outer(s, b - a)
    sampled = np.linalg.norm(along[:, None] - on[None], axis=2).min()
    # Samples are at most an eighth apart on each.
    assert sampled - 0.2 <= segment_triangle(*a, *b, corners.ravel()) <= sampled + 1e-6


def test_segment_distance_of_a_surface_is_the_least_of_its_triangles(slit):
    tree = build_triangle_tree(slit.surface.vertices, slit.surface.faces)
    start, end, _ = capsules_near(slit, 60, seed=4)
    for a, b in zip(start, end, strict=True):
        each = [segment_triangle(*a, *b, t) for t in tree.triangles]
        assert segment_distance(tree, *a, *b, np.inf) == min(each)
        assert segment_distance(tree, *a, *b, 1e-3) == min(*each, 1e-3)


def test_nested_shells_are_told_apart():
    tissue = tissue_of(surfaces.nested_shells())
    along = np.array([1.5, 4.5, 7.0, 9.0, 10.5])
    points = along[:, None] * np.array([[0.6, 0.0, 0.8]])
    assert tissue.contains(points).tolist() == [False, True, False, True, False]


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


def test_asked_spacing_too_coarse_for_the_wall_is_refused():
    with pytest.raises(TissueError, match=r"too coarse for walls of 0\.3 mm"):
        tissue_of(surfaces.thin_box(0.3), spacing_mm=0.5)
