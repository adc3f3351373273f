"""Resample a scan on a straight grid, correcting bow, fan and refraction."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numba
import numpy as np
from numpy.typing import NDArray

from kernels import pjit
from kernels.arrays import FloatArray
from registration.devices.optics.beam import Beam, OctCalibration, refraction_bound
from registration.devices.optics.surface import SampleSurface
from registration.devices.optics.targets import path_per_depth
from registration.errors import RegistrationError
from registration.files.readers.common import empty
from registration.scan import Scan
from registration.segmentation.volume import trilinear


@pjit
def warp(
    volume: NDArray[np.float32],
    lattice: NDArray[np.float32],
    step: int,
    lost: float,
    out: NDArray[np.float32],
) -> None:
    """Fill `out` (nz, ny, nx) with trilinear values of `volume`, and `lost` where there are none.

    `lattice` (nz, my, mx, 3) holds positions x, y, z in voxels of `volume` for every depth and
    every `step`-th row and column of `out`; between them it is interpolated.
    """
    nz, ny, nx = out.shape
    for z in numba.prange(nz):
        for y in range(ny):
            j = y // step
            v = y / step - j
            for x in range(nx):
                i = x // step
                u = x / step - i
                a, b = (1 - u) * (1 - v), u * (1 - v)
                c, d = (1 - u) * v, u * v
                low, high = lattice[z, j], lattice[z, j + 1]
                px = a * low[i, 0] + b * low[i + 1, 0] + c * high[i, 0] + d * high[i + 1, 0]
                py = a * low[i, 1] + b * low[i + 1, 1] + c * high[i, 1] + d * high[i + 1, 1]
                pz = a * low[i, 2] + b * low[i + 1, 2] + c * high[i, 2] + d * high[i + 1, 2]
                value = trilinear(volume, px, py, pz)
                out[z, y, x] = lost if np.isnan(value) else value


_STEP = 16
"""Rows and columns between places where the map is worked out; it is smooth."""
_PLANES = 32
_RELAID = "laid out anew by calibration"


@dataclass(frozen=True)
class _Grid:
    """The straight grid: true place of its first voxel and its voxels as x, y, z, mm."""

    origin: FloatArray
    voxel: FloatArray
    shape: tuple[int, int, int]


def undistort(
    scan: Scan, calibration: OctCalibration, surface: SampleSurface | None = None
) -> Scan:
    """The scan on a straight geometric grid.

    Parameters
    ----------
    scan : Scan
        An OCT scan, depth downwards.
    calibration : OctCalibration
        Of the device; its refractive index, where it has one, replaces the scan's.
    surface : SampleSurface or None
        The sample's surface where air lies above it (`find_surface`); None where liquid fills
        the view.

    Returns
    -------
    Scan
        float32, depth geometric; places that were not scanned hold the least value.

    Raises
    ------
    RegistrationError
        When the scan isn't OCT from above, or the correction is too large for its model.
    """
    if scan.modality != "oct" or not scan.depth_down:
        raise RegistrationError(
            f"{scan.came_from}: only an OCT scan with depth downwards is corrected for its beam"
        )
    optical_mm = path_per_depth(scan)
    if calibration.refractive_index is not None:
        scan = replace(scan, refractive_index=calibration.refractive_index)
    beam = Beam.of(scan, calibration, surface)
    per_voxel = np.array(scan.voxel_mm[::-1]) * np.array([1.0, 1.0, optical_mm])
    grid = _straight_grid(scan, beam, per_voxel)
    volume = _resampled(scan, beam, per_voxel, grid)
    note = f"{_RELAID}: {_note(beam, grid, scan)}"
    return replace(
        scan,
        volume=volume,
        voxel_mm=(float(grid.voxel[2]), float(grid.voxel[1]), float(grid.voxel[0])),
        optical_depth=False,
        space=None,
        depth_standard=calibration.depth_standard,
        lateral_error=calibration.relative_error("scale_x", "scale_y"),
        depth_error=calibration.relative_error("refractive_index"),
        notes=(*scan.notes, note),
    )


def is_resampled(scan: Scan) -> bool:
    """Whether a scan's voxels were laid out anew."""
    return any(note.startswith(_RELAID) for note in scan.notes)


def _straight_grid(scan: Scan, beam: Beam, per_voxel: FloatArray) -> _Grid:
    """A grid that holds all of the volume, no coarser than its voxels."""
    sides = [np.linspace(0, n - 1, 9) for n in scan.volume.shape[::-1]]
    box = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3) * per_voxel
    true = beam.to_true(box)
    voxel = per_voxel / np.array([1.0, 1.0, beam.index])
    low, high = true.min(axis=0), true.max(axis=0)
    counts = [math.floor(c) + 1 for c in (high - low) / voxel + 1e-6]
    return _Grid(low, voxel, (counts[2], counts[1], counts[0]))


def _resampled(scan: Scan, beam: Beam, per_voxel: FloatArray, grid: _Grid) -> NDArray[np.float32]:
    """Some planes at a time, reading only the depths that they need."""
    out = empty(grid.shape, np.dtype(np.float32), scan.came_from)
    lost = float(scan.volume.min())
    nz = scan.volume.shape[0]
    for first in range(0, grid.shape[0], _PLANES):
        planes = np.arange(first, min(first + _PLANES, grid.shape[0]))
        lattice = _lattice(planes, beam, per_voxel, grid)
        low = min(max(math.floor(float(lattice[..., 2].min())), 0), nz - 2)
        high = min(max(math.ceil(float(lattice[..., 2].max())) + 1, low + 2), nz)
        lattice[..., 2] -= low
        part = np.ascontiguousarray(scan.volume[low:high], dtype=np.float32)
        target = np.empty((len(planes), *grid.shape[1:]), np.float32)
        warp(part, lattice, _STEP, lost, target)
        out[planes[0] : planes[-1] + 1] = target
    return out  # type: ignore[return-value]


def _lattice(
    planes: NDArray[np.int64], beam: Beam, per_voxel: FloatArray, grid: _Grid
) -> NDArray[np.float32]:
    """Scan positions in voxels for some planes of the grid, rows and columns `_STEP` apart."""
    rows, columns = (np.arange(0, n + 2 * _STEP, _STEP) for n in grid.shape[1:])
    z, y, x = np.meshgrid(planes, rows, columns, indexing="ij")
    places = np.stack([x, y, z], axis=-1).reshape(-1, 3) * grid.voxel + grid.origin
    positions = beam.to_scan(places) / per_voxel
    return positions.reshape(*z.shape, 3).astype(np.float32)


def _note(beam: Beam, grid: _Grid, scan: Scan) -> str:
    """How much was moved, for people."""
    if beam.surface is None:
        return f"index {beam.index:g} throughout (liquid fills the view)"
    deep = grid.voxel[2] * scan.volume.shape[0] / 2
    aside, _ = refraction_bound(beam.surface.tilt_deg, deep, beam.index)
    return (
        f"surface under air tilted by {beam.surface.tilt_deg:.1f}°, index {beam.index:g} below "
        f"it; {1e3 * aside:.0f} µm aside at {deep:.1f} mm undone"
    )
