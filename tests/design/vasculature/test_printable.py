"""Largest printable trees: limits of lumen and wall kept."""

import re
from dataclasses import replace

import manifold3d
import numpy as np
import pytest

from design.errors import GrowthError, NoRoomError
from design.measures import MeasureOptions, measure_network
from design.solids import read_solid
from design.tissue import block, folded_cortex, tissue_from_surface
from design.vasculature import GrowthOptions, grow_tree, tree_radii, tree_to_network
from design.vasculature.growth.printable import grow_printable
from tests.design.tissue.kept import kept_tissue
from tests.design.vasculature.test_grow import SHARED, check


@pytest.fixture(scope="module")
def slab():
    shape = folded_cortex()
    return kept_tissue(shape)


@pytest.fixture(scope="module")
def brick():
    shape = block((6.0, 6.0, 4.0))
    return kept_tissue(shape)


@pytest.mark.slow
def test_says_how_far_it_grew(brick):
    options = GrowthOptions(
        terminals=30,
        smallest_radius_mm=0.2,
        clearance_mm=0.3,
        root_point_mm=tuple(brick.bounds.mean(axis=0) + [0.0, 0.0, 2.0]),
        root_direction=(0.0, 0.0, -1.0),
    )
    done = grow_printable(brick, options)
    assert 1 <= done.reached < 30
    assert f"grew {done.reached} of 30 terminals" in done.note
    check(done.tree, brick, done.options)
    assert tree_radii(done.tree).min() == pytest.approx(0.2)
    with pytest.raises(GrowthError):
        grow_printable(brick, GrowthOptions(terminals=5))


@pytest.mark.slow
def test_takes_a_deep_root_where_the_default_one_is_too_shallow():
    """Both ventricles, scaled to 60 mm: at the highest vertex the wall is too thin for a trunk."""
    path = SHARED / "biventricle_svv.stl"
    if not path.is_file():
        pytest.skip("no shared data beside the repository")
    mesh = read_solid(path, unit="mm")
    vertices = mesh.vertices * (60.0 / np.ptp(mesh.vertices, axis=0).max())
    tissue = tissue_from_surface(vertices, mesh.faces)
    options = GrowthOptions(terminals=300, smallest_radius_mm=0.2, clearance_mm=0.3)
    done = grow_printable(tissue, options)
    assert done.reached == 300
    assert done.options.root_point_mm is not None
    check(done.tree, tissue, done.options)


def test_a_printable_tree_reaches_the_whole_slab(slab):
    """Wide vessels reach what is far only if nearer places are held back until they have."""
    options = GrowthOptions(terminals=200, smallest_radius_mm=0.1, clearance_mm=0.1)
    network = tree_to_network(grow_printable(slab, options).tree)
    reach = measure_network(network, slab, MeasureOptions(seed=3))
    assert reach.supply.distance_p95_mm < 2.5


def test_a_tree_stuck_in_a_lobe_gives_way_to_one_from_a_deep_root():
    """Test a block with a ball on top, whose neck is too narrow for any vessel."""
    body = manifold3d.Manifold.cube((20.0, 20.0, 10.0))
    neck = manifold3d.Manifold.cylinder(2.5, 0.2, 0.2, 24).translate((5.0, 5.0, 9.5))
    ball = manifold3d.Manifold.sphere(3.0, 24).translate((5.0, 5.0, 14.0))
    mesh = (body + neck + ball).to_mesh()
    tissue = tissue_from_surface(np.asarray(mesh.vert_properties[:, :3], float), mesh.tri_verts)
    options = GrowthOptions(terminals=60, smallest_radius_mm=0.15, clearance_mm=0.1)
    tree = grow_tree(tissue, options, attempts=1)
    assert re.match(r"from the highest point only \d terminals fit, so", tree.notes[0])
    assert tree.proximal[0, 2] <= 10.0
    check(tree, tissue, options)
    given = replace(options, root_point_mm=tuple(tissue.top_vertex()[0]))
    with pytest.raises(NoRoomError, match=r"only \d of 60 terminals"):
        grow_tree(tissue, given, attempts=1)
