"""Place and size of scans and height maps against a look's lines; a laser line's frame file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from firmware_profiles.yaml_file import read_yaml
from kernels.arrays import FloatArray
from printctl.errors import UsageError
from printctl.inspection import ExpectedLines
from printctl.observe.devices import DeviceError
from registration.devices.laser_sweep import is_laser_file, read_laser
from registration.files.readers.heights import HeightMap, wrong_placement
from registration.scan import Scan

FRAME_KEY: Final = "printer_to_scan"
"""Where a frame's file, and a simulated device's own, hold the matrix."""
_MIN_LINE_SHARE: Final = 0.5
"""Share of the lines that must lie in a scan."""
_LINE_STATIONS: Final = np.linspace(0.05, 0.95, 10)
_MIN_HEIGHT_RATIO, _MAX_HEIGHT_RATIO = 0.3, 2.0
"""Times a layer's height, that its lines stand over the plate: a needle fixes it, and lines of
slumped or domed ink stood 0.75 to 1.0 over it."""
_MIN_INK_SEEN_SHARE: Final = 0.5
"""Share of the way seen with ink above which the map's heights are those of ink."""
_FRAME_KEYS: Final = frozenset({FRAME_KEY, "pixel_mm", "count_mm", "lost", "size"})


@dataclass(frozen=True)
class ScanSize:
    """Size and place of a scan or height map.

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
    def from_scan(scan: Scan, to_scan: FloatArray) -> ScanSize:
        """Return the size of a scan with frame ``to_scan`` (4, 4), mm, from printer to scan."""
        voxel, shape = scan.geometric_voxel_mm, scan.volume.shape
        last = (np.array(shape[::-1]) - 1) * np.array(voxel[::-1])
        corners = np.stack(np.meshgrid(*([0, n] for n in last)), axis=-1).reshape(-1, 3)
        words = _size_words(shape, voxel, "voxels", "x, y, depth", _ranges(corners, to_scan, 3))
        return ScanSize(voxel, words, to_scan, np.zeros(3), last)

    @staticmethod
    def from_heights(heights: HeightMap, to_map: FloatArray) -> ScanSize:
        """Return the size of a height map with frame ``to_map`` (4, 4), mm, from printer to map."""
        voxel, shape = heights.pixel_mm[::-1], heights.height_mm.shape
        low = np.array(heights.origin_mm)
        high = low + (np.array(shape[::-1]) - 1) * np.array(heights.pixel_mm)
        measured = heights.height_mm[np.isfinite(heights.height_mm)]
        usual = float(np.median(measured)) if len(measured) else 0.0
        corners = np.array([(x, y, usual) for x in (low[0], high[0]) for y in (low[1], high[1])])
        words = _size_words(shape, voxel, "heights", "x, y", _ranges(corners, to_map, 2))
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
    places = start + _LINE_STATIONS[:, None, None] * (end - start)
    at = (places @ size.to_scan[:3, :3].T + size.to_scan[:3, 3])[..., : len(size.low_mm)]
    inside = ((at >= size.low_mm - margin) & (at <= size.high_mm + margin)).all(axis=-1)
    length = np.linalg.norm(end - start, axis=1) + 1e-9
    share = float(np.average(inside.mean(axis=0), weights=length))
    if share >= _MIN_LINE_SHARE:
        return
    raise DeviceError(
        f"{share:.0%} of the lines lie in the scan: they are at "
        f"{_range_words(np.concatenate([start, end]))}, the scan has "
        f"{size.words}; scan that place, or correct the voxel size (in the file or beside it) or "
        "observe.frame, then resume"
    )


def _size_words(
    shape: tuple[int, ...], voxel_mm: tuple[float, ...], what: str, axes: str, covers: str
) -> str:
    count = " × ".join(str(n) for n in shape[::-1])
    size = " × ".join(f"{1000.0 * mm:.3g}" for mm in voxel_mm[::-1])
    return f"{count} {what} of {size} µm ({axes}) and covers {covers}"


def _ranges(corners: FloatArray, to_scan: FloatArray, axes: int) -> str:
    """Return in words the printer's range that a scan's corners (n, 3) cover."""
    at = np.column_stack([corners, np.ones(len(corners))])
    return _range_words((at @ np.linalg.inv(to_scan).T)[:, :axes])


def _range_words(places: FloatArray) -> str:
    each = zip("xyz", places.min(axis=0), places.max(axis=0), strict=False)
    return ", ".join(f"{name} {a:.2f} to {b:.2f}" for name, a, b in each) + " mm"


def refuse_other_height(size: ScanSize | None, seen_share: float, coverage: float) -> None:
    """Refuse a height map in which the first layer's ink shows, but far too flat or tall.

    Parameters
    ----------
    size : ScanSize or None
    seen_share, coverage : float
        As of `LayerFindings`.

    Raises
    ------
    DeviceError
    """
    if (
        size is None
        or not seen_share * coverage > _MIN_INK_SEEN_SHARE
        or not math.isfinite(size.stands)
    ):
        return
    if _MIN_HEIGHT_RATIO < size.stands < _MAX_HEIGHT_RATIO:
        return
    raise DeviceError(
        f"the lines show, but stand {size.stands:.2g} times their layer's height over the plate "
        f"beside them ({_MIN_HEIGHT_RATIO:.1g} to {_MAX_HEIGHT_RATIO:g} may be): check the "
        "heights' unit (count_mm in observe.frame: 1 for mm, 0.001 for µm), or how far the "
        "needle is from the plate, then resume"
    )


@dataclass(frozen=True)
class ProfilerFrame:
    """Frame and units of a laser profiler, which its files lack.

    Attributes
    ----------
    to_map : (4, 4) float64
        Takes the printer's places to the profiler's, mm.
    pixel_mm : (x, y) or None, mm
    count_mm : float, mm
    lost : float or None
        These three as of `read_heights`.
    size : (x, y) or None
        Columns and rows of a whole map.
    """

    to_map: FloatArray
    pixel_mm: tuple[float, float] | None = None
    count_mm: float = 1.0
    lost: float | None = None
    size: tuple[int, int] | None = None


def read_matrix(path: Path, device: str, known: frozenset[str] | None = None) -> dict[str, Any]:
    """Read a frame's YAML file with ``printer_to_scan``, as a (4, 4) array; other keys as they are.

    Raises
    ------
    UsageError
        When there is none, it isn't a matrix that can be undone, or a key isn't ``known``.
    """
    try:
        data = dict(read_yaml(path.read_text(encoding="utf-8")))
        matrix = np.array(data[FRAME_KEY], dtype=float)
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError) as exc:
        raise UsageError(
            f"observe.frame {path} can't be read ({exc}); for {device} it is a YAML file with "
            f"{FRAME_KEY}: four rows of four numbers, mm"
        ) from exc
    if wrong := wrong_placement(matrix):
        raise UsageError(f"observe.frame {path}: {FRAME_KEY} {wrong}")
    if known is not None and (strange := sorted(set(data) - known)):
        raise UsageError(
            f"observe.frame {path}: {', '.join(strange)} means nothing; known are "
            f"{', '.join(sorted(known))}"
        )
    return {**data, FRAME_KEY: matrix}


def read_profiler_frame(path: Path) -> ProfilerFrame:
    """Read a laser profiler's frame.

    Raises
    ------
    UsageError
        When it can't be read, or a value isn't what it must be.
    """
    data = read_matrix(path, "a laser profiler", _FRAME_KEYS)
    size = data.get("size")
    try:
        pixel = data.get("pixel_mm")
        if pixel is not None:
            x, y = (float(one) for one in pixel)
            pixel = (x, y)
        count, lost = float(data.get("count_mm", 1.0)), data.get("lost")
        lost = None if lost is None else float(lost)
    except (TypeError, ValueError) as exc:
        raise UsageError(
            f"observe.frame {path}: pixel_mm is two numbers [x, y], count_mm and lost are one each"
        ) from exc
    if not all(0 < one < np.inf for one in (count, *(pixel or ()))):
        raise UsageError(f"observe.frame {path}: pixel_mm and count_mm must be above 0 mm")
    two = isinstance(size, list) and len(size) == 2
    if size is not None and not (two and all(type(one) is int and one >= 16 for one in size)):
        raise UsageError(
            f"observe.frame {path}: size is {size!r}; it is [columns, rows] of a whole height "
            "map, whole numbers of 16 and more"
        )
    whole = None if size is None else (size[0], size[1])
    return ProfilerFrame(data[FRAME_KEY], pixel, count, lost, whole)


def try_laser_frame(path: Path) -> None:
    """Read the frame of a profiler, or of a laser line with a camera.

    Raises
    ------
    UsageError, PictureError
        When it can't be read.
    """
    if is_laser_file(path):
        read_laser(path)
    else:
        read_profiler_frame(path)
