"""Lumen surface from a scan: true size, ends extended to the ports."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from skimage.measure import marching_cubes

from design.errors import FlowError
from design.network import VesselNetwork
from design.solids import Solid, write_ply
from design.solids.manifolds import to_manifold
from kernels.arrays import FloatArray
from printctl.analysis.flow.scanned import blur_squared, scanned_lumen, set_out
from printctl.errors import UsageError
from tests.design.hemodynamics.three_d.surfaces import faceted_tube, straight

RADIUS, LENGTH, STEP, SHRUNK = 0.25, 1.5, 0.025, 0.98


def scanned_block() -> tuple[FloatArray, NDArray[np.int32]]:
    """The surface of gel with a channel along z through it, as voxels see it."""
    across = np.arange(-0.7, 0.7 + STEP / 2, STEP)
    up = np.arange(-0.2, LENGTH + 0.2 + STEP / 2, STEP)
    x, y, z = np.meshgrid(across, across, up, indexing="ij")
    outside = np.maximum(
        np.maximum(np.abs(x), np.abs(y)) - 0.55, np.abs(z - LENGTH / 2) - LENGTH / 2
    )
    gel = np.minimum(np.hypot(x, y) - RADIUS, -outside)
    volume = np.clip(0.5 + gel / STEP, 0.0, 1.0)
    points, faces, _, _ = marching_cubes(volume, 0.5, spacing=(STEP,) * 3)
    points = points.astype(np.float64) + [across[0], across[0], up[0]]
    a, b, c = points[faces].transpose(1, 0, 2)
    turned = np.einsum("fd,fd->", a, np.cross(b, c)) < 0.0
    return points, (faces[:, ::-1] if turned else faces).astype(np.int32)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A scan of a part that shrank by 2 %, stretched onto its design as registration leaves it."""
    points, faces = scanned_block()
    surface = Solid(points / SHRUNK, faces)
    write_ply(
        tmp_path / "deviation.ply",
        surface,
        scalar=np.zeros(len(points)),
        scalar_name="deviation_um",
    )
    rigid, scaled = np.eye(4), np.diag([1.0 / SHRUNK] * 3 + [1.0])
    numbers = {
        "transform_scan_to_part": rigid.tolist(),
        "scaled_scan_to_part": scaled.tolist(),
        "measured_by": {"voxel_um": [25.0, 25.0, 25.0]},
    }
    (tmp_path / "registration.json").write_text(json.dumps(numbers))
    return tmp_path


def designed() -> VesselNetwork:
    """Before it shrank, with the radius that was measured of the print."""
    return straight(RADIUS, LENGTH / SHRUNK)


def test_the_lumen_has_the_print_s_own_size_up_to_its_ends(run: Path) -> None:
    found = scanned_lumen(run, designed())
    assert_allclose(found.network.lengths(), LENGTH, rtol=1e-6)
    assert_allclose(found.network.mean_radius(), RADIUS)
    between = (found.surface.vertices[:, 2] > 0.0) & (found.surface.vertices[:, 2] < LENGTH)
    radius = np.hypot(*found.surface.vertices[between, :2].T)
    assert_allclose(np.median(radius), RADIUS, rtol=0.01)
    # Nothing of the rounded mouths, where the gel's faces are.
    assert radius.max() < 1.05 * RADIUS
    assert found.surface.vertices[:, 2].min() < 0.0
    assert found.surface.vertices[:, 2].max() > LENGTH


def test_a_lumen_that_isn_t_there_is_refused_with_volumes(run: Path) -> None:
    network = straight(RADIUS, LENGTH / SHRUNK).moved(np.array([5.0, 0.0, 0.0]))
    with pytest.raises(FlowError, match="µL of lumen where the measured vessels have"):
        scanned_lumen(run, network)


def test_a_run_without_the_scan_s_surface_is_told(run: Path) -> None:
    (run / "deviation.ply").unlink()
    with pytest.raises(UsageError, match="there is none at"):
        scanned_lumen(run, designed())


def test_a_registration_without_transforms_is_told(run: Path) -> None:
    (run / "registration.json").write_text("{}")
    with pytest.raises(UsageError, match="has no measured_by"):
        scanned_lumen(run, designed())


def test_a_wall_that_blur_moved_inwards_is_set_out_again() -> None:
    squared = 0.03**2
    seen = RADIUS - squared / (2.0 * RADIUS)
    lumen = to_manifold(*faceted_tube(seen, LENGTH, 256, 0.3), "a tube")
    network = straight(RADIUS, LENGTH)
    assert_allclose(blur_squared(lumen, network), squared, rtol=0.03)
    assert_allclose(blur_squared(set_out(lumen, network), network), 0.0, atol=0.03 * squared)
