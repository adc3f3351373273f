"""Hold the place and size of a scan against the lines that a look needs to see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from printctl.observe.devices import DeviceError
from registration.layer_images import ExpectedLines
from registration.scan import Scan

_LEAST: Final = 0.5
"""Share of the lines that must lie in a scan."""
_ALONG: Final = np.linspace(0.05, 0.95, 10)


@dataclass(frozen=True)
class ScanSize:
    """How large a scan is.

    Attributes
    ----------
    voxel_mm : (float, float, float), mm
        Geometric; depth, y, x.
    words : str
        Its voxels, and where it lies.
    """

    voxel_mm: tuple[float, float, float]
    words: str

    @staticmethod
    def of(scan: Scan, to_scan: FloatArray) -> ScanSize:
        """Size of a scan whose frame takes the printer's places to its own, (4, 4), mm."""
        count = " × ".join(str(n) for n in scan.volume.shape[::-1])
        size = " × ".join(f"{1000.0 * mm:.3g}" for mm in scan.geometric_voxel_mm[::-1])
        last = np.array(scan.volume.shape[::-1]) - 1
        corners = np.stack(np.meshgrid(*([0, n] for n in last)), axis=-1).reshape(-1, 3)
        at = np.column_stack([corners * _voxel(scan), np.ones(len(corners))])
        place = (at @ np.linalg.inv(to_scan).T)[:, :3]
        where = _range_words(place.min(axis=0), place.max(axis=0))
        words = f"{count} voxels of {size} µm (x, y, depth) and covers {where}"
        return ScanSize(scan.geometric_voxel_mm, words)


def refuse_elsewhere(scan: Scan, to_scan: FloatArray, lines: ExpectedLines) -> None:
    """Refuse a scan that holds less than half of the fresh lines.

    Parameters
    ----------
    scan : Scan
    to_scan : (4, 4) float64
        Takes the printer's places to the scan's frame, mm.
    lines : ExpectedLines

    Raises
    ------
    DeviceError
    """
    fresh = lines.fresh
    if not fresh.any():
        return
    start, end, margin = lines.start[fresh], lines.end[fresh], float(np.median(lines.width_mm))
    length = np.linalg.norm(end - start, axis=1) + 1e-9
    along = [_inside(start + t * (end - start), scan, to_scan, margin) for t in _ALONG]
    share = float(np.average(np.mean(along, axis=0), weights=length))
    if share >= _LEAST:
        return
    places = np.concatenate([start, end])
    raise DeviceError(
        f"{share:.0%} of the lines lie in the scan: they are at "
        f"{_range_words(places.min(axis=0), places.max(axis=0))}, the scan has "
        f"{ScanSize.of(scan, to_scan).words}; scan that place, or correct the voxel size (in the "
        "file or beside it) or observe.frame, then resume"
    )


def _voxel(scan: Scan) -> FloatArray:
    return np.array(scan.geometric_voxel_mm[::-1])


def _inside(places: FloatArray, scan: Scan, to_scan: FloatArray, margin_mm: float) -> FloatArray:
    """1 for places (n, 3) in the scan or less than a margin beside it, else 0; (n,)."""
    at = places @ to_scan[:3, :3].T + to_scan[:3, 3]
    most = (np.array(scan.volume.shape[::-1]) - 1) * _voxel(scan) + margin_mm
    return np.asarray(((at >= -margin_mm) & (at <= most)).all(axis=1), dtype=np.float64)


def _range_words(low: FloatArray, high: FloatArray) -> str:
    each = zip("xyz", low, high, strict=True)
    return ", ".join(f"{name} {a:.2f} to {b:.2f}" for name, a, b in each) + " mm"
