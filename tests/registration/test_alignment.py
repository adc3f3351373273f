"""Alignment of analytic surface points: convergence, mirror images, symmetry, scale."""

from __future__ import annotations

from dataclasses import replace

import manifold3d
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from design.solids.solid import Solid
from kernels.arrays import FloatArray
from registration.alignment import AlignmentOptions, align
from registration.alignment.distance import ModelSurface
from registration.alignment.uncertainty import ScanErrors
from registration.errors import AlignmentError
from tests.registration.parts import corners, planar_construct, rod, solid
from tests.slower import first_of

FAST = AlignmentOptions(coarse_points=700, fine_points=5000, contest_points=40_000)
SIZE = (16.0, 8.0, 3.0)


def surface_points(part: Solid, count: int, seed: int) -> FloatArray:
    """Points spread evenly over the surface, with 5 µm of noise."""
    rng = np.random.default_rng(seed)
    triangles = part.vertices[part.faces]
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(normal, axis=1)
    chosen = rng.choice(len(area), count, p=area / area.sum())
    a, b = np.sort(rng.uniform(size=(2, count)), axis=0)
    weight = np.stack([a, b - a, 1 - b], axis=1)[:, :, None]
    return (triangles[chosen] * weight).sum(axis=1) + rng.normal(0, 0.005, (count, 3))


def placed(points: FloatArray, seed: int, stretch: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points and the part's corners as a scanner looking down would see them."""
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(0, 2 * np.pi)
    tilt = np.deg2rad(rng.uniform(0, 10)) * np.array([np.cos(azimuth), np.sin(azimuth), 0])
    turn = Rotation.from_rotvec(tilt) * Rotation.from_rotvec([0, 0, rng.uniform(0, 2 * np.pi)])
    flip = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    shift = rng.uniform(-3, 3, 3)
    both = np.concatenate([points, corners(SIZE)]) * stretch
    moved = (turn * flip).apply(both) + shift
    return moved[: len(points)], moved[len(points) :]


@pytest.fixture(scope="module")
def construct() -> Solid:
    return planar_construct()


@pytest.mark.parametrize("seed", first_of(range(4)))
def test_any_turn_with_tilt_and_shift_lands(construct: Solid, seed: int) -> None:
    shrink = np.array([0.98, 0.985, 0.975])
    points, truth = placed(surface_points(construct, 60_000, seed), seed, shrink)
    found = align(ModelSurface.of(construct), points, True, FAST)
    error = np.linalg.norm(found.scaled.apply(truth) - corners(SIZE), axis=1).max()
    assert error < 0.010
    np.testing.assert_allclose(found.scaled.scale, shrink, atol=1e-3)
    assert abs(np.linalg.det(found.rigid.matrix[:3, :3]) - 1) < 1e-9
    assert not found.ambiguous


def test_mirrored_points_are_refused_though_one_dimple_alone_tells(construct: Solid) -> None:
    points, _ = placed(surface_points(construct, 60_000, 1) * [-1, 1, 1], 7, np.ones(3))
    with pytest.raises(AlignmentError, match="mirror"):
        align(ModelSurface.of(construct), points, True, FAST)


@pytest.mark.slow
def test_walls_of_unknown_errors_prove_no_mirror_image(construct: Solid) -> None:
    points, _ = placed(surface_points(construct, 60_000, 1) * [-1, 1, 1], 7, np.ones(3))
    unknown = replace(ScanErrors.of_blur(0.03), level_mm=float("nan"))
    found = align(ModelSurface.of(construct), points, True, FAST, errors=unknown)
    assert any("mirrored" in doubt for doubt in found.doubts)


def test_a_surface_that_little_light_reached_proves_no_mirror_image(construct: Solid) -> None:
    points, _ = placed(surface_points(construct, 60_000, 1) * [-1, 1, 1], 7, np.ones(3))
    found = align(ModelSurface.of(construct), points, True, FAST, lit=0.3)
    assert any("mirrored" in doubt for doubt in found.doubts)


def test_symmetric_part_is_flagged_ambiguous() -> None:
    block = manifold3d.Manifold.cube((10, 6, 3))
    channel = manifold3d.Manifold.cube((12, 1, 1)).translate((-1, 2.5, 1))
    mesh = (block - channel).to_mesh()
    part = Solid(np.asarray(mesh.vert_properties[:, :3], float), np.asarray(mesh.tri_verts))
    points, _ = placed(surface_points(part, 40_000, 0), 3, np.ones(3))
    found = align(ModelSurface.of(part), points, True, FAST)
    assert found.ambiguous
    assert found.margin < 1.5


def test_thin_part_leaves_depth_unscaled() -> None:
    block = manifold3d.Manifold.cube((10, 6, 1.0)) - manifold3d.Manifold.cube((2, 3, 1))
    mesh = block.to_mesh()
    part = Solid(np.asarray(mesh.vert_properties[:, :3], float), np.asarray(mesh.tri_verts))
    points, _ = placed(surface_points(part, 40_000, 0), 3, np.array([0.98, 0.98, 0.9]))
    found = align(ModelSurface.of(part), points, True, FAST)
    assert not found.depth_fitted
    assert found.scaled.scale[2] == 1.0


def test_another_part_is_refused(construct: Solid) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-9, 9, (30_000, 3))
    with pytest.raises(AlignmentError, match="of the scanned surface"):
        align(ModelSurface.of(construct), points, True, FAST)


def test_too_few_points_are_refused(construct: Solid) -> None:
    with pytest.raises(AlignmentError, match="too few"):
        align(ModelSurface.of(construct), np.zeros((10, 3)), True, FAST)


def test_a_vessel_wider_all_along_leaves_scale_and_offset_alone() -> None:
    """Where the block may stretch along all axes lumens' walls alone tell scale from offset."""
    designed, printed = (
        manifold3d.Manifold.cube((10.0, 6.0, 2.6))
        - manifold3d.Manifold.batch_boolean(
            [
                rod(np.array([0, y, 1.2]), np.array([10.0, y, 1.2]), radius)
                for y, radius in ((1.2, wide), (2.6, 0.25), (3.7, 0.35), (4.9, 0.3))
            ],
            manifold3d.OpType.Add,
        )
        for wide in (0.45, 0.51)
    )
    seen = surface_points(solid(printed), 30_000, 3)
    seen += np.random.default_rng(4).normal(0, 0.006, seen.shape)
    found = align(ModelSurface.of(solid(designed)), seen, True, FAST).scaled
    np.testing.assert_allclose(found.scale[:2], 1, atol=1.5e-3)
    assert abs(found.offset_mm) < 0.006
