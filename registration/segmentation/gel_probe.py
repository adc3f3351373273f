"""Tell gel from none at any place of a segmented scan, and whether the scan can tell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import maximum_filter

from kernels.arrays import BoolArray, FloatArray
from registration.segmentation.evidence import GelEvidence, are_separable
from registration.segmentation.filters import bin_mean
from registration.segmentation.segment import Segmentation
from registration.segmentation.volume import GelField, Strength

_EDGE_VOXELS: Final = 2
"""Of the working grid, at the field's border, where smoothing knows nothing."""
_BLOCK_MM: Final = 0.15
"""Over blocks of this width signal is averaged to ask whether light came so deep."""
_BESIDE_BLOCKS: Final = 5
"""What light reaches here it reaches so many blocks aside."""


@dataclass(frozen=True, eq=False)
class GelReading:
    """What a scan shows at places.

    Attributes
    ----------
    gel : (...,) bool
        Where there is gel by the segmentation.
    known : (...,) bool
        Within the field of view, where light came so deep and the noise leaves gel and liquid
        apart.
    """

    gel: BoolArray
    known: BoolArray


class GelProbe:
    """Reads gel at places of one scan.

    Parameters
    ----------
    segmentation : Segmentation
    depth_down : bool
        Whether light runs towards the scan's larger z.
    evidence : GelEvidence, optional
        Of the segmentation; without it noise is taken to leave gel and liquid apart everywhere.
    calibrated : bool
        Whether walls are read where a calibration has them, or where the scan's level has them. A
        wall that moves by a share of a line's height would take its outermost lines for missing.
    """

    def __init__(
        self,
        segmentation: Segmentation,
        depth_down: bool,
        evidence: GelEvidence | None = None,
        *,
        calibrated: bool = True,
    ) -> None:
        self._field, self._evidence = segmentation.field, evidence
        self._calibrated = calibrated
        strength = segmentation.strength
        self._reach = None
        if strength is not None:
            self._reach = _Reach(strength, depth_down, self._field.voxel_mm)

    def at(self, points: FloatArray) -> GelReading:
        """Read (..., 3) scan positions, mm."""
        read = _above_level if self._calibrated else GelField.above_level
        above = read(self._field, points)
        where = (points - self._field.origin_mm) / self._field.voxel_mm
        last = np.array(self._field.values.shape[::-1]) - 1
        well = ((where >= _EDGE_VOXELS) & (where <= last - _EDGE_VOXELS)).all(axis=-1)
        known = well & np.isfinite(above)
        if self._reach is not None:
            known &= self._reach.lit(where)
        if self._evidence is not None:
            known &= are_separable(1.0, 0.0, self._evidence.scatter_at(points))
        return GelReading(np.nan_to_num(above, nan=-1.0) > 0, known)


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

    def __init__(self, strength: Strength, depth_down: bool, voxel_mm: FloatArray) -> None:
        signal = strength.signal
        wanted = np.maximum(1, np.round(_BLOCK_MM / voxel_mm[::-1])).astype(int)
        self._bins = np.minimum(wanted, signal.shape)
        bz, by, bx = self._bins.tolist()
        lit = bin_mean(signal, (bz, by, bx), False) > strength.noise
        self._down = depth_down
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
