"""Find the surface of a sample scanned through air, and fit a quadratic to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from kernels.arrays import FloatArray
from registration.devices.optics.targets import in_decibels, path_per_depth
from registration.errors import SegmentationError
from registration.scan import Scan

_OVER_NOISE_DB = 6.0
_LEAST_SHARE = 0.3
_CELL_MM = 0.1
_ROUNDS = 8


@dataclass(frozen=True)
class SampleSurface:
    """Optical depth of the surface: c₀ + c₁x + c₂y + c₃x² + c₄xy + c₅y², about a centre.

    Attributes
    ----------
    centre_mm : (2,) float64, mm
        x and y about which it is written.
    coefficients : (6,) float64
        In mm and 1/mm.
    scatter_mm : float, mm
        Robust standard deviation of what it was fitted to.
    """

    centre_mm: FloatArray
    coefficients: FloatArray
    scatter_mm: float

    def depth_mm(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Optical depth at scan positions."""
        return _basis(x - self.centre_mm[0], y - self.centre_mm[1]) @ self.coefficients

    @property
    def tilt_deg(self) -> float:
        """Slope in the middle, degrees."""
        return float(np.degrees(np.arctan(np.hypot(*self.coefficients[1:3]))))


def fit_surface(x: FloatArray, y: FloatArray, depth: FloatArray) -> SampleSurface:
    """Fit a surface to points (n,), leaving out what lies more than three deviations off.

    Raises
    ------
    SegmentationError
        When there are fewer than 20 points.
    """
    if len(x) < 20:
        raise SegmentationError(
            f"only {len(x)} columns show a surface (needed: 20); check that air lies above the "
            "sample in the scan"
        )
    centre = np.array([x.mean(), y.mean()])
    basis = _basis(x - centre[0], y - centre[1])
    keep = np.ones(len(x), dtype=bool)
    coefficients: FloatArray = np.zeros(6)
    scatter = 0.0
    for _ in range(_ROUNDS):
        coefficients = np.asarray(np.linalg.lstsq(basis[keep], depth[keep])[0], dtype=np.float64)
        off = np.abs(depth - basis @ coefficients)
        scatter = 1.4826 * float(np.median(off))
        keep = off <= max(3 * scatter, 1e-6)
    return SampleSurface(centre, coefficients, scatter)


def find_surface(scan: Scan) -> SampleSurface:
    """The surface of a sample that is scanned from above through air.

    Depth by depth from above: a column's surface is where its smoothed brightness first climbs
    halfway (in dB) from the noise of the topmost depths to its own maximum.

    Raises
    ------
    SegmentationError
        When less than a third of the columns show one.
    """
    dz, dy, dx = scan.voxel_mm
    step_y, step_x = (max(1, round(_CELL_MM / size)) for size in (dy, dx))
    heights = []
    for first in range(0, scan.volume.shape[1] - step_y + 1, step_y):
        values = _cells(scan, slice(first, first + step_y), step_x)
        heights.append(_first_rise(values))
    depth = np.array(heights)
    seen = np.isfinite(depth)
    if seen.mean() < _LEAST_SHARE:
        raise SegmentationError(
            f"{100 * seen.mean():.0f} % of the columns show a surface under air (needed: "
            f"{100 * _LEAST_SHARE:.0f} %); leave out --air-above when liquid fills the view"
        )
    x = (np.arange(depth.shape[1]) * step_x + (step_x - 1) / 2) * dx
    y = (np.arange(depth.shape[0]) * step_y + (step_y - 1) / 2) * dy
    grid_y, grid_x = np.meshgrid(y, x, indexing="ij")
    return fit_surface(grid_x[seen], grid_y[seen], depth[seen] * dz * path_per_depth(scan))


def _cells(scan: Scan, part: slice, step_x: int) -> FloatArray:
    """Mean brightness in dB of cells along one row, as z, x, smoothed along z."""
    values = in_decibels(scan, part)
    count = values.shape[2] // step_x
    mean = values[:, :, : count * step_x].reshape(*values.shape[:2], count, step_x)
    return np.asarray(gaussian_filter(mean.mean(axis=(1, 3)), (1.0, 0.0)))


def _first_rise(values: FloatArray) -> FloatArray:
    """Depth in voxels of the first rise in each column; NaN where there is none."""
    top = max(3, len(values) // 20)
    noise, peak = np.median(values[:top], axis=0), values.max(axis=0)
    level = (noise + peak) / 2
    above = values > level
    at = np.argmax(above, axis=0)
    before = np.maximum(at - 1, 0)
    columns = np.arange(values.shape[1])
    low, high = values[before, columns], values[at, columns]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = before + np.clip((level - low) / (high - low), 0, 1)
    clear = (peak - noise > 2 * _OVER_NOISE_DB) & (at > top)
    return np.where(clear, depth, np.nan)


def _basis(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
