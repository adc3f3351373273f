"""Alignment from any pose: inverted, mirrored, partial, symmetric or nearly so."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from design.solids.solid import Solid
from kernels.arrays import FloatArray
from registration.alignment import Alignment, AlignmentOptions, align
from registration.alignment.distance import ModelSurface
from registration.errors import AlignmentError
from tests.registration.parts import corners, planar_construct, rod, solid
from tests.registration.test_alignment import surface_points

SIZE = np.array([16.0, 8.0, 3.0])
FEW = AlignmentOptions(fine_points=5000, contest_points=20_000)
UPRIGHT = np.diag([1.0, -1.0, -1.0])
TURNED_OVER = np.eye(3)


@pytest.fixture(scope="module")
def construct() -> Solid:
    return planar_construct()


def block(dimple: tuple[float, float] | None = None) -> Solid:
    """A block with two equal channels, which half turns leave as it is; and a mark."""
    shape = manifold3d.Manifold.cube((10, 6, 3))
    for y in (1.5, 4.5):
        shape -= rod(np.array([-1, y, 1.5]), np.array([11, y, 1.5]), 0.4)
    if dimple:
        shape -= manifold3d.Manifold.sphere(0.5, 32).translate((*dimple, 3.0))
    return solid(shape)


def aligned(part: Solid, points: FloatArray, rotation: FloatArray) -> tuple[Alignment, float]:
    """The alignment of points that lie so under light from above, and its largest error, mm."""
    size = part.vertices.max(axis=0)
    where = corners((size[0], size[1], size[2])) @ rotation.T + [1.0, -2.0, 3.0]
    found = align(ModelSurface.of(part), points @ rotation.T + [1.0, -2.0, 3.0], True, FEW)
    off = found.scaled.apply(where) - corners((size[0], size[1], size[2]))
    return found, float(np.linalg.norm(off, axis=1).max())


def tilted(rotation: FloatArray, seed: int) -> FloatArray:
    turn = np.random.default_rng(seed).uniform(-9, 9, 3)
    return np.asarray(Rotation.from_euler("xyz", turn, degrees=True).as_matrix() @ rotation)


@pytest.mark.parametrize(
    ("rotation", "lay"),
    [
        (TURNED_OVER, "turned over"),
        pytest.param(
            Rotation.from_euler("y", 90, degrees=True).as_matrix(),
            "on its side",
            marks=pytest.mark.slow,
        ),
        (Rotation.from_euler("xz", [-90, 40], degrees=True).as_matrix(), "on its side"),
        (Rotation.from_rotvec([1.1, 0.7, -0.9]).as_matrix(), ""),
    ],
)
def test_a_part_lands_however_it_lies(construct: Solid, rotation: FloatArray, lay: str) -> None:
    found, error = aligned(construct, surface_points(construct, 20_000, 1), tilted(rotation, 1))
    assert error < 0.02
    assert not found.ambiguous, found.doubts
    assert found.lay.startswith(lay)


@pytest.mark.slow
def test_a_mirrored_part_is_refused_however_it_lies(construct: Solid) -> None:
    points = surface_points(construct, 20_000, 2) * [-1, 1, 1]
    with pytest.raises(AlignmentError, match="mirror image"):
        aligned(construct, points, tilted(TURNED_OVER, 2))


def test_a_piece_that_may_be_slid_says_along_which_axis() -> None:
    part = block((1.0, 1.0))
    points = surface_points(part, 60_000, 4)
    points = points[(points[:, 0] > 3.5) & (points[:, 0] < 7.0)]
    found, _ = aligned(part, points, tilted(UPRIGHT, 4))
    assert found.ambiguous
    assert any("its place along x" in doubt for doubt in found.doubts)


@pytest.mark.slow
def test_a_symmetric_design_names_the_turns_that_nothing_tells() -> None:
    part = block()
    found, _ = aligned(part, surface_points(part, 20_000, 5), tilted(UPRIGHT, 5))
    said = " ".join(found.doubts)
    for axis in "xyz":
        assert f"the same after a half turn about {axis}" in said


def test_one_mark_tells_where_it_is_seen_and_is_asked_for_where_it_is_not() -> None:
    part = block((1.0, 1.0))
    points = surface_points(part, 60_000, 6)
    found, error = aligned(part, points, tilted(TURNED_OVER, 6))
    assert error < 0.02
    assert not found.ambiguous, found.doubts
    hidden = points[points[:, 0] > 1.8]
    found, _ = aligned(part, hidden, tilted(UPRIGHT, 6))
    assert any("x 1." in doubt and "wasn't seen" in doubt for doubt in found.doubts), found.doubts


@pytest.mark.slow
def test_a_face_that_the_others_outvote_is_named(construct: Solid) -> None:
    points = surface_points(construct, 20_000, 7)
    points[points[:, 2] < 0.05, 2] -= 0.29
    found, error = aligned(construct, points, UPRIGHT)
    assert error < 0.02
    assert "flat faces that face low z are off the design by +29" in found.doubts[0]
