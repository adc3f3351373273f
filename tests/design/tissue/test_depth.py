from pathlib import Path

import numpy as np
import pytest

from benchmarks.checkers.containment import surface_tree, to_surface, winding_numbers
from design.geometry import build_triangle_tree
from design.tissue import load_tissue
from design.tissue.depth import depth_bounds, winding_number
from tests.design.tissue import surfaces
from tests.design.tissue.kept import kept_tissue

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


def test_winding_number_counts_overlapping_solids_and_no_cavity():
    shapes = [surfaces.surface(surfaces.sphere(r)) for r in (6.0, 4.0)]
    vertices = np.concatenate([s.vertices for s in shapes])
    faces = np.concatenate([shapes[0].faces, shapes[1].faces + len(shapes[0].vertices)])
    tree = build_triangle_tree(vertices, faces)
    assert [winding_number(tree, x, 0.0, 0.0) for x in (0.0, 5.0, 7.0, -5.0)] == [2, 1, 0, 1]
    hollow = surfaces.hollow_sphere()
    tree = build_triangle_tree(hollow.vertices, hollow.faces)
    assert [winding_number(tree, x, 0.0, 0.0) for x in (0.0, 8.0, 11.0)] == [0, 1, 0]
