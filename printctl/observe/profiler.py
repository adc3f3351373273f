"""Load a profiler's heights, or a camera's sweep of a laser line, as a layer's surface."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from firmware_profiles.yaml_file import read_yaml
from kernels.arrays import FloatArray
from printctl.errors import UsageError
from printctl.observe.camera_holds import refuse_moved
from printctl.observe.devices import DeviceError
from printctl.observe.scan_place import ScanSize, refuse_elsewhere
from registration.devices.laser_sweep import is_laser_file, read_laser, sweep_heights, trace
from registration.errors import PictureError, ScanFileError
from registration.files.readers.heights import HeightMap, read_heights, wrong_placement
from registration.inspection import ExpectedLines, Surface, surface_of

FRAME_KEY: Final = "printer_to_scan"
"""Where a frame's file, and a simulated device's own, hold the matrix."""
_ASIDE_MM: Final = 2.0
"""Heights are laid out so far beyond the lines."""
_HIGHEST: Final = 1.5
"""Layers over a layer's top, from which on heights are of something else."""
_FLATTEST, _TALLEST = 0.3, 2.0
"""Times a layer's height, that its lines stand over the plate: a needle fixes it, and lines of
slumped or domed ink stood 0.75 to 1.0 over it."""
_SHOWS: Final = 0.5
"""Of the way, with ink on it, from which on what stands there is ink."""
_KEYS: Final = frozenset({FRAME_KEY, "pixel_mm", "count_mm", "lost", "size"})


@dataclass(frozen=True)
class ProfilerFrame:
    """What a profiler's files don't say themselves.

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
    data = read_matrix(path, "a laser profiler", _KEYS)
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
    return ProfilerFrame(data[FRAME_KEY], pixel, count, lost, _size(path, data.get("size")))


def _size(path: Path, value: Any) -> tuple[int, int] | None:
    """Columns and rows of a whole map, where its frame says them."""
    if value is None:
        return None
    good = isinstance(value, list) and len(value) == 2
    if not good or not all(type(one) is int and one >= 16 for one in value):
        raise UsageError(
            f"observe.frame {path}: size is {value!r}; it is [columns, rows] of a whole height "
            "map, whole numbers of 16 and more"
        )
    return value[0], value[1]


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


def open_surface(
    path: Path,
    frame_file: str,
    middle_z_mm: float,
    thickness_mm: float,
    lines: ExpectedLines,
) -> tuple[Surface, ScanSize, HeightMap]:
    """Return a layer's surface, how large the height map is, and the map as it was read.

    Parameters
    ----------
    path : Path
    frame_file : str
        Path of the profiler's frame, or of `printctl observe sweep`; empty for a simulated
        profiler's own.
    middle_z_mm, thickness_mm : float, mm
        Of the layer that is looked at.
    lines : ExpectedLines

    Raises
    ------
    DeviceError
        When it can't be read, measured nothing, holds another place than the lines, stands far
        over the layer, or shows that the camera or the insert was moved.
    UsageError
        When the frame can't be read.
    """
    if frame_file and is_laser_file(Path(frame_file)):
        heights, to_map, whole = _swept(path, Path(frame_file), lines), np.eye(4), None
    else:
        heights, to_map, whole = _read(path, frame_file)
    size = replace(ScanSize.of_heights(heights, to_map), whole=whole)
    refuse_elsewhere(size, lines)
    try:
        surface = surface_of(heights, to_map, middle_z_mm, thickness_mm, lines)
    except PictureError as exc:
        raise DeviceError(f"{path}: {exc}") from exc
    over = f"{1000.0 * surface.over_mm:+.0f} µm over the layer's top along the lines"
    if surface.over_mm > _HIGHEST * thickness_mm:
        raise DeviceError(
            f"the map lies {over}, more than {_HIGHEST:g} of its layers of "
            f"{1000.0 * thickness_mm:.0f} µm: check the heights' unit (count_mm) and the z of "
            f"{FRAME_KEY} in observe.frame, or see what covers the layer, then resume"
        )
    if np.isfinite(surface.over_mm):
        size = replace(size, words=f"{size.words}, and lies {over}")
    return surface, replace(size, stands=surface.stands_mm / thickness_mm), heights


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
    if size is None or not seen_share * coverage > _SHOWS or not math.isfinite(size.stands):
        return
    if _FLATTEST < size.stands < _TALLEST:
        return
    raise DeviceError(
        f"the lines show, but stand {size.stands:.2g} times their layer's height over the plate "
        f"beside them ({_FLATTEST:.1g} to {_TALLEST:g} may be): check the heights' unit (count_mm "
        "in observe.frame: 1 for mm, 0.001 for µm), or how far the needle is from the plate, then "
        "resume"
    )


def _read(path: Path, frame_file: str) -> tuple[HeightMap, FloatArray, tuple[int, int] | None]:
    """Heights of a file, what takes the printer's places to them, (4, 4), and a map's usual size.

    The size is in rows and columns, None where nobody said it.
    """
    frame = read_profiler_frame(Path(frame_file)) if frame_file else ProfilerFrame(np.eye(4))
    try:
        heights = read_heights(path, frame.pixel_mm, frame.count_mm, frame.lost)
    except (ScanFileError, OSError) as exc:
        raise DeviceError(" ".join(str(exc).split())) from exc
    told = None if frame_file else heights.to_map
    whole = None if frame.size is None or heights.placed else frame.size[::-1]
    return heights, frame.to_map if told is None else told, whole


def _swept(path: Path, laser_file: Path, lines: ExpectedLines) -> HeightMap:
    """Heights around the lines by a camera's pictures of a laser line, printer's frame."""
    laser = read_laser(laser_file)
    places = np.concatenate([lines.start, lines.end])[:, :2]
    try:
        traced = trace(path, laser.frame)
        refuse_moved(traced.ground, laser.frame, path)
        low, high = places.min(axis=0) - _ASIDE_MM, places.max(axis=0) + _ASIDE_MM
        return sweep_heights(traced, laser, low, high)
    except PictureError as exc:
        raise DeviceError(" ".join(str(exc).split())) from exc
