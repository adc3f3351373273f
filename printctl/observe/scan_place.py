"""Hold the place and size of a scan or height map against the lines that a look needs to see."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from printctl.observe.devices import DeviceError
from registration.files.readers.heights import HeightMap
from registration.inspection import ExpectedLines
from registration.scan import Scan

_LEAST: Final = 0.5
"""Share of the lines that must lie in a scan."""
_ALONG: Final = np.linspace(0.05, 0.95, 10)


@dataclass(frozen=True)
class ScanSize:
    """How large a scan or height map is, and where it lies.

    Attributes
    ----------
    voxel_mm : (float, ...), mm
        Geometric; depth, y, x, or y, x of a height map.
    words : str
        Its voxels, and where it lies.
    to_scan : (4, 4) float64
        Takes the printer's places to its frame, mm.
    low_mm, high_mm : (3,) or (2,) float64, mm
        Its corners in its own frame: x, y, depth, or x, y.
    stands : float
        Height of ink over the bare plate beside it, of what it should be; NaN where it isn't known.
    whole : (rows, columns) or None
        Of a whole height map, as its frame says.
    placed : bool
        As of `HeightMap`.
    """

    voxel_mm: tuple[float, ...]
    words: str
    to_scan: FloatArray
    low_mm: FloatArray
    high_mm: FloatArray
    stands: float = math.nan
    whole: tuple[int, int] | None = None
    placed: bool = False

    @staticmethod
    def of(scan: Scan, to_scan: FloatArray) -> ScanSize:
        """Size of a scan whose frame takes the printer's places to its own, (4, 4), mm."""
        voxel, shape = scan.geometric_voxel_mm, scan.volume.shape
        last = (np.array(shape[::-1]) - 1) * np.array(voxel[::-1])
        corners = np.stack(np.meshgrid(*([0, n] for n in last)), axis=-1).reshape(-1, 3)
        where = _covered(corners, to_scan, 3)
        words = f"{_count_words(shape, voxel)} (x, y, depth) and covers {where}"
        return ScanSize(voxel, words, to_scan, np.zeros(3), last)

    @staticmethod
    def of_heights(heights: HeightMap, to_map: FloatArray) -> ScanSize:
        """Size of a height map whose frame takes the printer's places to its own, (4, 4), mm."""
        voxel, shape = heights.pixel_mm[::-1], heights.height_mm.shape
        low = np.array(heights.origin_mm)
        high = low + (np.array(shape[::-1]) - 1) * np.array(heights.pixel_mm)
        measured = heights.height_mm[np.isfinite(heights.height_mm)]
        usual = float(np.median(measured)) if len(measured) else 0.0
        corners = np.array([(x, y, usual) for x in (low[0], high[0]) for y in (low[1], high[1])])
        where = _covered(corners, to_map, 2)
        words = f"{_count_words(shape, voxel)} (x, y) and covers {where}"
        return ScanSize(voxel, words, to_map, low, high, placed=heights.placed)


def refuse_elsewhere(size: ScanSize, lines: ExpectedLines) -> None:
    """Refuse a scan or height map that holds less than half of the fresh lines.

    Raises
    ------
    DeviceError
    """
    fresh = lines.fresh
    if not fresh.any():
        return
    start, end, margin = lines.start[fresh], lines.end[fresh], float(np.median(lines.width_mm))
    length = np.linalg.norm(end - start, axis=1) + 1e-9
    along = [_inside(start + t * (end - start), size, margin) for t in _ALONG]
    share = float(np.average(np.mean(along, axis=0), weights=length))
    if share >= _LEAST:
        return
    places = np.concatenate([start, end])
    raise DeviceError(
        f"{share:.0%} of the lines lie in the scan: they are at "
        f"{_range_words(places.min(axis=0), places.max(axis=0))}, the scan has "
        f"{size.words}; scan that place, or correct the voxel size (in the file or beside it) or "
        "observe.frame, then resume"
    )


def _count_words(shape: tuple[int, ...], voxel_mm: tuple[float, ...]) -> str:
    count = " × ".join(str(n) for n in shape[::-1])
    size = " × ".join(f"{1000.0 * mm:.3g}" for mm in voxel_mm[::-1])
    return f"{count} {'voxels' if len(shape) == 3 else 'heights'} of {size} µm"


def _covered(corners: FloatArray, to_scan: FloatArray, axes: int) -> str:
    """Which range of the printer's axes corners (n, 3) of a scan's frame cover, in words."""
    at = np.column_stack([corners, np.ones(len(corners))])
    place = (at @ np.linalg.inv(to_scan).T)[:, :axes]
    return _range_words(place.min(axis=0), place.max(axis=0))


def _inside(places: FloatArray, size: ScanSize, margin_mm: float) -> FloatArray:
    """1 for places (n, 3) in the scan or less than a margin beside it, else 0; (n,)."""
    at = (places @ size.to_scan[:3, :3].T + size.to_scan[:3, 3])[:, : len(size.low_mm)]
    inside = (at >= size.low_mm - margin_mm) & (at <= size.high_mm + margin_mm)
    return np.asarray(inside.all(axis=1), dtype=np.float64)


def _range_words(low: FloatArray, high: FloatArray) -> str:
    each = zip("xyz", low, high, strict=False)
    return ", ".join(f"{name} {a:.2f} to {b:.2f}" for name, a, b in each) + " mm"
