import numpy as np
import pytest

from benchmarks.checkers.containment import surface_tree, to_surface, winding_numbers
from design.errors import TissueError
from design.tissue import BlockZone, SpacingRule, block, carve, tissue_from_surface
from tests.design.tissue import surfaces


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
