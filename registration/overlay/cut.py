"""Sample a scan, and cut it at a layer's height."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from kernels.arrays import BoolArray, FloatArray
from registration.overlay.raster import Raster
from registration.scan import Scan
from registration.segmentation import Segmentation
from registration.segmentation.filters import bin_mean
from registration.segmentation.volume import GelField, Strength

# Sample a scan at arbitrary positions, and map its values to grey shades.

PERCENTILES = (1.0, 99.0)
"""Of the scan's values, shown black and white."""
_SAMPLES = 1_000_000


@dataclass(frozen=True)
class Shades:
    """Which values of a scan are shown black and white, the same in all of its pictures.

    Attributes
    ----------
    low, high : float
        In the scan's own scale, or its root.
    root : bool
        Linear OCT: amplitude. Its logarithm would put a wall, which lies at half the gel's signal,
        outside the place where a picture grows dark.
    """

    low: float
    high: float
    root: bool

    @staticmethod
    def of(scan: Scan) -> Shades:
        """Return the shades of a scan, from a sample of its voxels."""
        steps = [max(1, round((scan.volume.size / _SAMPLES) ** (1 / 3)))] * 3
        some = np.asarray(scan.volume[:: steps[0], :: steps[1], :: steps[2]], dtype=np.float64)
        root = scan.modality == "oct" and scan.scale == "linear"
        values = some[np.isfinite(some)]
        if len(values) == 0:
            return Shades(0.0, 1.0, False)
        values = np.sqrt(np.maximum(values, 0.0)) if root else values
        low, high = np.percentile(values, PERCENTILES)
        return Shades(float(low), float(max(high, low + 1e-12)), root)

    def grey(self, values: NDArray[np.generic]) -> NDArray[np.uint8]:
        """Return values as 0 (black) to 255 (white); black where there is none."""
        plain = np.asarray(values, dtype=np.float64)
        if self.root:
            plain = np.sqrt(np.maximum(plain, 0.0))
        share = (np.nan_to_num(plain, nan=self.low) - self.low) / (self.high - self.low)
        return np.rint(255 * np.clip(share, 0.0, 1.0)).astype(np.uint8)


def trilinear(scan: Scan, points: FloatArray) -> NDArray[np.float32]:
    """The scan's own values at (..., 3) positions, mm, scan frame; NaN beyond its voxels.

    Only what is asked for is read, so that a volume that stays in its file may.
    """
    size = np.array(scan.volume.shape[::-1])
    where = points / np.array(scan.geometric_voxel_mm[::-1])
    inside = ((where >= 0) & (where <= size - 1)).all(axis=-1)
    low = np.clip(np.floor(where[inside]).astype(np.int64), 0, size - 2)
    i, j, k = low.T
    part = (where[inside] - low).T
    (u, v, w), total = zip(1 - part, part, strict=True), np.zeros(len(low))
    values = np.asarray(scan.volume)  # a file's map makes a new map of whatever is taken from it
    for a, b, c in np.ndindex(2, 2, 2):
        total += u[a] * v[b] * w[c] * values[k + c, j + b, i + a]
    out = np.full(where.shape[:-1], np.nan, np.float32)
    out[inside] = total
    return out


_EDGE_VOXELS: Final = 2
"""Of the working grid, at the field's border, where smoothing knows nothing."""
_BLOCK_MM: Final = 0.15
"""Over blocks of this width signal is averaged to ask whether light came so deep."""
_BESIDE_BLOCKS: Final = 5
"""What light reaches here it reaches so many blocks aside."""


@dataclass(frozen=True, eq=False)
class ScanCut:
    """A scan on the pixels of a raster, each (ny, nx).

    Attributes
    ----------
    grey : float32
        The scan's own values, trilinear, in its own scale; NaN beyond the field of view.
    gel : bool
        Where the product's segmentation has gel.
    in_view : bool
        Within the field of view.
    seen : bool
        In view, and light came so deep.
    """

    grey: NDArray[np.float32]
    gel: BoolArray
    in_view: BoolArray
    seen: BoolArray


class Cutter:
    """Cuts one scan at heights of the part.

    Parameters
    ----------
    scan : Scan
    segmentation : Segmentation
        Of that scan.
    scan_to_part : (4, 4) float64
        The pose, mm.
    """

    def __init__(self, scan: Scan, segmentation: Segmentation, scan_to_part: FloatArray) -> None:
        self._scan, self._field = scan, segmentation.field
        self._back = np.linalg.inv(scan_to_part)
        strength = segmentation.strength
        self._reach = None if strength is None else _Reach(strength, scan, self._field.voxel_mm)

    def cut(self, raster: Raster, height_mm: float) -> ScanCut:
        """Cut at a height of the part, mm."""
        x, y = np.meshgrid(raster.x_mm, raster.y_mm)
        places = np.stack([x, y, np.full_like(x, height_mm)], axis=-1)
        points = places @ self._back[:3, :3].T + self._back[:3, 3]
        grey = trilinear(self._scan, points)
        above = _above_level(self._field, points)
        where = (points - self._field.origin_mm) / self._field.voxel_mm
        last = np.array(self._field.values.shape[::-1]) - 1
        well = ((where >= _EDGE_VOXELS) & (where <= last - _EDGE_VOXELS)).all(axis=-1)
        in_view = np.isfinite(grey)
        seen = in_view & well & np.isfinite(above)
        if self._reach is not None:
            seen &= self._reach.lit(where)
        return ScanCut(grey, np.nan_to_num(above, nan=-1.0) > 0, in_view, seen)


def _above_level(field: GelField, points: FloatArray) -> FloatArray:
    """As `GelField.above_level`, with walls where a calibration has them truly lie.

    A place is gel when one that lies `wall_mm` nearer to the liquid is gel by the level.
    """
    if not field.wall_mm:
        return field.above_level(points)
    steps = np.diag(field.voxel_mm / 2)
    rise = np.stack(
        [field.above_level(points + d) - field.above_level(points - d) for d in steps], axis=-1
    )
    rise /= field.voxel_mm
    size = np.linalg.norm(rise, axis=-1, keepdims=True)
    outward = np.nan_to_num(-rise / np.where(size > 0, size, 1.0))
    return field.above_level(points + field.wall_mm * outward)


class _Reach:
    """How deep light came in each part of an OCT's field.

    What lies above something that sends light back was lit itself, liquid too. Signal is averaged
    over blocks and held against the noise floor, as it is for the scanned surface.
    """

    def __init__(self, strength: Strength, scan: Scan, voxel_mm: FloatArray) -> None:
        signal = strength.signal
        wanted = np.maximum(1, np.round(_BLOCK_MM / voxel_mm[::-1])).astype(int)
        self._bins = np.minimum(wanted, signal.shape)
        bz, by, bx = self._bins.tolist()
        lit = bin_mean(signal, (bz, by, bx), False) > strength.noise
        self._down = scan.depth_down
        down = lit if self._down else lit[::-1]
        depth = np.arange(1, len(down) + 1)[:, None, None]
        deepest = np.where(down, depth, 0).max(axis=0)
        self._blocks = maximum_filter(deepest, 2 * _BESIDE_BLOCKS + 1)
        self._count = len(lit)

    def lit(self, where: FloatArray) -> BoolArray:
        """Whether light came to (..., 3) positions x, y, z of the working grid."""
        last = np.array(self._blocks.shape[::-1]) - 1
        i, j = (
            np.clip(where[..., k] // self._bins[2 - k], 0, last[k]).astype(np.int64)
            for k in range(2)
        )
        block = where[..., 2] // self._bins[0]
        depth = block if self._down else self._count - 1 - block
        return np.asarray(depth < self._blocks[j, i])
