"""Growth in cut, imaged or repaired tissues: trees stay inside."""

import numpy as np
import pytest
import trimesh

from benchmarks.checkers.containment import surface_tree, to_surface, winding_numbers
from design.errors import GrowthError
from design.tissue import (
    CylinderZone,
    SphereZone,
    VolumeImage,
    block,
    carve,
    folded_cortex,
    label_surface,
    load_tissue,
)
from design.vasculature import GrowthOptions, grow_tree, tree_radii
from tests.design.tissue import surfaces
from tests.design.tissue.kept import KeptTissues
from tests.slower import first_of

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


def outside(tree, tissue):
    """Segments whose lumen isn't in the tissue; the root apart."""
    corners = tissue.surface.vertices[tissue.surface.faces]
    exact = surface_tree(corners)
    start, end, radius = tree.proximal[1:], tree.distal[1:], tree_radii(tree)[1:] - 1e-9
    away = to_surface(start, end, radius, exact, corners[exact.order])
    return int(((away < radius) | (winding_numbers(end, corners, exact) <= 0)).sum())


@pytest.mark.parametrize("seed", first_of(range(10)))
@pytest.mark.parametrize("name", first_of(MAKERS, 2))
def test_tree_stays_in_tissue(tissues, name, seed):
    root = FREE if name == "needle" else {}
    tree = grow_tree(tissues[name], GrowthOptions(terminals=40, seed=seed, **root))
    assert (tree.children[:, 0] < 0).sum() == 40
    assert outside(tree, tissues[name]) == 0


def test_no_vessel_touches_the_needle(tissues):
    tree = grow_tree(tissues["needle"], GrowthOptions(terminals=300, seed=1, **FREE))
    t = np.linspace(0, 1, 21)[None, :, None]
    axis = tree.proximal[:, None] + t * (tree.distal - tree.proximal)[:, None]
    way = np.subtract(NEEDLE.to_mm, NEEDLE.from_mm)
    way /= np.linalg.norm(way)
    to = axis - NEEDLE.from_mm
    away = np.linalg.norm(to - (to @ way)[..., None] * way, axis=2).min(axis=1)
    assert (away > NEEDLE.radius_mm + tree_radii(tree) - 1e-9).all()


def test_root_in_the_needles_way_is_refused(tissues):
    into = {"root_point_mm": (3.0, 5.0, 0.0), "root_direction": (0.3, 0.0, 1.0)}
    with pytest.raises(GrowthError):
        grow_tree(tissues["needle"], GrowthOptions(terminals=40, **into))


def test_root_outside_is_refused(tissues):
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
    assert outside(grow_tree(tissue, GrowthOptions(terminals=40)), tissue) == 0
