"""Convert a volume of grey values that encode dB to dB, by a stated window or slope."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from registration.counts import CountLine
from registration.errors import ScanFileError
from registration.files.readers.raw_result import Array
from registration.files.readers.storage import empty

COUNT_KEYS = ("db_range", "count_range", "counts_per_db", "db_at_zero")
"""What can be said of counts, by the names of `ScanOverrides`."""

_MOST_DB = 1000.0
_MOST_SPAN_DB = 200.0
_SLAB_VOXELS = 1 << 24


def layered(*layers: Mapping[str, Any]) -> dict[str, Any]:
    """Merge descriptions of a scan, later ones first; grey values described by one of them."""
    known: dict[str, Any] = {}
    for layer in layers:
        if any(layer.get(name) is not None for name in COUNT_KEYS):
            known = {name: value for name, value in known.items() if name not in COUNT_KEYS}
        known |= layer
    return known


def with_scale(known: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """What is known, with scale "db" where counts of dB are described.

    Raises
    ------
    ScanFileError
        When such a description stands beside another scale.
    """
    given = [name for name in COUNT_KEYS if known.get(name) is not None]
    if not given:
        return dict(known)
    if known.get("scale") not in (None, "db"):
        raise ScanFileError(
            f"{path}: {given[0]} is given, but the scale is {known['scale']!r}; give scale db, or "
            f"leave {', '.join(given)} out"
        )
    return {**known, "scale": "db"}


def in_decibels(
    volume: Array, known: Mapping[str, Any], path: Path, keep: bool = False
) -> tuple[Array, CountLine | None]:
    """A volume whose scale is "db" as dB: integers become float32 unless a count is a dB.

    `keep`: counts of up to 16 bit stay, and the line is returned that makes dB of them.

    Raises
    ------
    ScanFileError
        When nobody says what a count means, or what is said is impossible.
    """
    line = count_line(volume.dtype, known, path)
    if line is None:
        return volume, None
    if known.get("count_range") is not None:
        _check_within(volume, known["count_range"], path)
    if keep and volume.dtype.kind in "ui" and volume.dtype.itemsize <= 2:
        return volume, line
    return volume if line.plain else _converted(volume, line, path), None


def count_line(
    kind: np.dtype[np.generic], known: Mapping[str, Any], path: Path
) -> CountLine | None:
    """How counts become dB; None for floating-point dB of which nothing is said."""
    window, counts = known.get("db_range"), known.get("count_range")
    slope, offset = known.get("counts_per_db"), known.get("db_at_zero")
    if window is not None and (slope is not None or offset is not None):
        raise ScanFileError(f"{path}: give db_range or counts_per_db (db_at_zero), not both")
    if counts is not None and window is None:
        raise ScanFileError(f"{path}: count_range is given without db_range; give both")
    if offset is not None and slope is None:
        raise ScanFileError(f"{path}: db_at_zero is given without counts_per_db; give both")
    if window is not None:
        return _by_window(_pair(window, "db_range", path), counts, kind, path)
    if slope is not None:
        return _by_slope(slope, 0.0 if offset is None else offset, path)
    if kind.kind in "ui":
        raise ScanFileError(
            f"{path}: holds dB as integers ({kind}) but doesn't say what a count means; give "
            "--db-range LOW,HIGH (dB of the lowest and the highest count), or --counts-per-db 1 "
            "where a count is a dB"
        )
    return None


def _by_window(
    window: tuple[float, float], counts: Any, kind: np.dtype[np.generic], path: Path
) -> CountLine:
    if counts is not None:
        first, last = _pair(counts, "count_range", path)
    elif kind.kind in "ui":
        bounds = np.iinfo(kind.name)
        first, last = float(bounds.min), float(bounds.max)
    else:
        raise ScanFileError(
            f"{path}: db_range is given for {kind} numbers, which have no range of their own; "
            "give count_range (the numbers that mean its two ends) too"
        )
    if window[1] - window[0] > _MOST_SPAN_DB:
        raise ScanFileError(
            f"{path}: db_range spans {window[1] - window[0]:g} dB (limit {_MOST_SPAN_DB:g}); give "
            "dB, not counts"
        )
    slope = (last - first) / (window[1] - window[0])
    return CountLine(slope, window[0] - first / slope)


def _by_slope(slope: Any, offset: Any, path: Path) -> CountLine:
    if not (_is_number(slope) and slope > 0):
        raise ScanFileError(f"{path}: counts_per_db is {slope!r}; it must be a number above 0")
    if not (_is_number(offset) and abs(offset) <= _MOST_DB):
        raise ScanFileError(f"{path}: db_at_zero is {offset!r}; it must be dB within ± {_MOST_DB}")
    return CountLine(float(slope), float(offset))


def _pair(value: Any, name: str, path: Path) -> tuple[float, float]:
    if isinstance(value, list | tuple) and len(value) == 2:
        low, high = value
        if _is_number(low) and _is_number(high) and low < high:
            return float(low), float(high)
    raise ScanFileError(f"{path}: {name} is {value!r}; it must be two numbers, the lower one first")


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _check_within(volume: Array, counts: Any, path: Path) -> None:
    least = min(float(part.min()) for part in volume)
    most = max(float(part.max()) for part in volume)
    if least < counts[0] or most > counts[1]:
        raise ScanFileError(
            f"{path}: counts run from {least:g} to {most:g}, beyond count_range {list(counts)}; "
            "give the counts that mean the two ends of db_range"
        )


def _converted(volume: Array, line: CountLine, path: Path) -> Array:
    """Float32, part by part along the axis that is slowest in memory."""
    out = empty(volume.shape, np.dtype(np.float32), path)
    axis = int(np.argmax(np.abs(volume.strides)))
    step = max(1, _SLAB_VOXELS * volume.shape[axis] // volume.size)
    for first in range(0, volume.shape[axis], step):
        part = [slice(None)] * 3
        part[axis] = slice(first, first + step)
        out[tuple(part)] = line.decibels(volume[tuple(part)])
    return out
