"""Signed distances of tissues, exact where they must be; trees grown in cut and repaired ones."""

import numpy as np
import pytest
import trimesh
from hypothesis import example, given
from hypothesis import strategies as st

from benchmarks.checkers.containment import surface_tree, to_surface, winding_numbers
from design.errors import GrowthError, TissueError
from design.geometry import build_triangle_tree
from design.geometry.surface_distances import segment_distance, segment_triangle
from design.tissue import (
    BlockZone,
    CylinderZone,
    SpacingRule,
    SphereZone,
    Surface,
    VolumeImage,
    block,
    carve,
    folded_cortex,
    label_surface,
    load_tissue,
    tissue_from_surface,
)
from design.tissue.grid import depth_bounds, winding_number
from design.vasculature import GrowthOptions, grow_tree, tree_radii
from tests.design.tissue import surfaces
from tests.design.tissue.kept import (
    KeptTissues,
    inside_exactly,
    kept_tissue,
    lumens_outside,
    shared,
)
from tests.slower import first_of


@pytest.fixture(scope="module")
def hollow():
    return kept_tissue(surfaces.hollow_sphere())


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


def test_distance_of_hollow_sphere_is_that_of_two_spheres_and_never_read_deeper(hollow):
    points = random_points(hollow, 5_000)
    away = np.linalg.norm(points, axis=1)
    expected = np.maximum(away - 10, 6 - away)
    near = np.abs(expected) < 1.0
    # Facets of 64 sides leave the sphere by 0.01 mm; the rest is the reading.
    np.testing.assert_allclose(hollow.grid.distance(points)[near], expected[near], atol=0.05)
    points = random_points(hollow, 4_000, seed=6)
    away = np.linalg.norm(points, axis=1)
    inside = (away < 9.95) & (away > 6.05)
    exact = np.minimum(10 - away, away - 6)[inside]
    read = -hollow.grid.distance(points[inside])
    assert (read - exact).max() < hollow.grid.error_mm + 0.03


@pytest.mark.slow
def test_torus_keeps_its_hole_outside():
    tissue = kept_tissue(surfaces.torus())
    points = random_points(tissue, 20_000)
    ring = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 8, points[:, 2]) - 3
    clear = np.abs(ring) > 0.1
    np.testing.assert_array_equal(tissue.contains(points)[clear], (ring < 0)[clear])


def test_overlapping_solids_count_once_nested_ones_and_an_inside_out_one_as_meant():
    one, two = surfaces.sphere(6.0), surfaces.sphere(6.0).translate((5.0, 0.0, 0.0))
    tissue = tissue_from_surface(*surfaces.joined(*map(surfaces.surface, (one, two))))
    union = surfaces.surface(one + two)
    assert tissue.volume_mm3 == pytest.approx(union.volume_mm3, rel=1e-3)
    assert tissue.contains(np.array([[2.5, 0.0, 0.0]])).all()
    tissue = kept_tissue(surfaces.nested_shells())
    along = np.array([1.5, 4.5, 7.0, 9.0, 10.5])
    points = along[:, None] * np.array([[0.6, 0.0, 0.8]])
    assert tissue.contains(points).tolist() == [False, True, False, True, False]
    shape = surfaces.hollow_sphere()
    tissue = kept_tissue(Surface(shape.vertices, shape.faces[:, ::-1]))
    assert tissue.volume_mm3 == pytest.approx(shape.volume_mm3)
    assert tissue.contains(np.array([[8.0, 0, 0], [0, 0, 0]])).tolist() == [True, False]


def test_walls_too_thin_for_any_grid_or_for_the_asked_one_are_refused_with_figures():
    with pytest.raises(TissueError, match=r"walls of 0\.001 mm need a grid spacing of .* MB"):
        kept_tissue(surfaces.thin_box(0.001))
    rule = SpacingRule(bricks=500, bricks_at_most=600)
    shape = surfaces.thin_box(0.05)
    with pytest.raises(TissueError, match=r"walls of 0\.05 mm need a grid spacing of 0\.0125 mm"):
        tissue_from_surface(shape.vertices, shape.faces, rule=rule)
    with pytest.raises(TissueError, match=r"too coarse for walls of 0\.3 mm"):
        kept_tissue(surfaces.thin_box(0.3), spacing_mm=0.5)


@pytest.mark.slow
def test_grid_is_the_same_whatever_the_number_of_threads():
    import numba

    shape = surfaces.hollow_sphere()
    threads = numba.get_num_threads()
    many = kept_tissue(shape).grid.arrays
    numba.set_num_threads(1)
    try:
        one = kept_tissue(shape).grid.arrays
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
    rng = np.random.default_rng(0)
    start = rng.uniform([10, 0, 0], [20, 20, 4], (20_000, 3))
    end = start + rng.normal(0, 0.3, start.shape)
    radius = rng.uniform(0.01, 0.2, len(start))
    expected = inside_exactly(tissue, start, end, radius)
    assert expected.any()
    np.testing.assert_array_equal(tissue.grid.capsule_inside(start, end, radius), expected)


@pytest.mark.slow
def test_piece_cut_at_a_slant_is_prepared():
    shape, _ = carve(surfaces.hollow_sphere(), (), [BlockZone((-9, -9, 8.5), (9, 9, 12))])
    assert kept_tissue(shape).volume_mm3 > 0


@pytest.fixture(scope="module")
def slit():
    # The slit is open space, not a thin wall: no finer grid is asked for.
    return kept_tissue(surfaces.slit_block(), spacing_mm=0.3)


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


def test_capsules_are_judged_exactly_where_a_slit_is_thinner_than_a_cell(slit):
    assert slit.grid.spacing_mm > 0.05
    start, end, radius = capsules_near(slit, 8_000)
    expected = inside_exactly(slit, start, end, radius)
    assert expected.any()
    assert not expected.all()
    np.testing.assert_array_equal(slit.grid.capsule_inside(start, end, radius), expected)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param("biventricle_svv.stl", marks=pytest.mark.slow), "gyrus_patch_fsaverage5.stl"],
)
def test_capsules_are_judged_exactly_in_real_tissue(name):
    tissue = load_tissue(shared(name), "mm")
    start, end, radius = capsules_near(tissue, 50_000)
    expected = inside_exactly(tissue, start, end, radius)
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
    tree = build_triangle_tree(*surfaces.joined(*shapes))
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


def test_wall_of_a_third_of_a_millimetre_is_seen():
    tissue = kept_tissue(surfaces.thin_box(0.3))
    assert tissue.thinnest_wall_mm == pytest.approx(0.3, abs=1e-6)
    assert tissue.grid.spacing_mm <= 0.3 / 4 + 1e-9
    points = np.array([[6.0, 6.0, z] for z in (11.5, 11.75, 11.85, 11.95, 12.1)])
    assert tissue.contains(points).tolist() == [False, True, True, True, False]
    np.testing.assert_allclose(tissue.grid.distance(points[2:3]), -0.15, atol=0.02)


# Growth in cut, imaged or repaired tissues: trees stay inside.


NEEDLE = CylinderZone((3.0, 5.0, -1.0), (7.0, 5.0, 11.0), 0.6)
FREE = {"root_point_mm": (1.5, 1.5, 10.0), "root_direction": (0.0, 0.0, -1.0)}


def needle_block():
    return carve(block((10.0, 10.0, 10.0)), [NEEDLE])[0]


def ported_cortex():
    zones = [SphereZone((26.0, 16.0, -2.8), 2.0), CylinderZone((8, -1, -4), (8, 33, -4), 0.5)]
    return carve(folded_cortex(), zones)[0]


def shell_image():
    index = np.stack(np.meshgrid(*[np.arange(36.0)] * 3, indexing="ij"), axis=-1)
    away = np.linalg.norm(index - 17.6, axis=-1)
    voxels = ((away < 16) & (away > 9)).astype(np.uint8)
    return label_surface(VolumeImage(voxels, np.diag([0.4, 0.4, 0.4, 1.0])), 1)[0]


MAKERS = {"needle": needle_block, "ported cortex": ported_cortex, "shell image": shell_image}


@pytest.fixture(scope="module")
def tissues():
    return KeptTissues(MAKERS)


@pytest.mark.parametrize("seed", first_of(range(10)))
@pytest.mark.parametrize("name", first_of(MAKERS, 2))
def test_tree_stays_in_tissue(tissues, name, seed):
    root = FREE if name == "needle" else {}
    tree = grow_tree(tissues[name], GrowthOptions(terminals=40, seed=seed, **root))
    assert (tree.children[:, 0] < 0).sum() == 40
    assert lumens_outside(tree, tissues[name]) == 0


def test_no_vessel_touches_the_needle(tissues):
    tree = grow_tree(tissues["needle"], GrowthOptions(terminals=300, seed=1, **FREE))
    t = np.linspace(0, 1, 21)[None, :, None]
    axis = tree.proximal[:, None] + t * (tree.distal - tree.proximal)[:, None]
    way = np.subtract(NEEDLE.to_mm, NEEDLE.from_mm)
    way /= np.linalg.norm(way)
    to = axis - NEEDLE.from_mm
    away = np.linalg.norm(to - (to @ way)[..., None] * way, axis=2).min(axis=1)
    assert (away > NEEDLE.radius_mm + tree_radii(tree) - 1e-9).all()


def test_root_in_the_needles_way_or_outside_is_refused(tissues):
    into = {"root_point_mm": (3.0, 5.0, 0.0), "root_direction": (0.3, 0.0, 1.0)}
    with pytest.raises(GrowthError):
        grow_tree(tissues["needle"], GrowthOptions(terminals=40, **into))
    away = {"root_point_mm": (30.0, 30.0, 30.0), "root_direction": (1.0, 0.0, 0.0)}
    with pytest.raises(GrowthError, match="root at"):
        grow_tree(tissues["needle"], GrowthOptions(terminals=40, **away))
    assert not tissues["needle"].contains(np.array([[30.0, 30.0, 30.0]])).any()


def test_tangled_mesh_grows_once_repaired(tmp_path):
    shape = surfaces.surface(surfaces.sphere(10.0, 48))
    faces = np.delete(shape.faces, [3, 700], axis=0)
    faces[:40] = faces[:40, ::-1]
    trimesh.Trimesh(shape.vertices, faces, process=False).export(tmp_path / "ball.stl")
    tissue = load_tissue(tmp_path / "ball.stl", "mm")
    assert len(tissue.notes) == 1
    assert lumens_outside(grow_tree(tissue, GrowthOptions(terminals=40)), tissue) == 0
