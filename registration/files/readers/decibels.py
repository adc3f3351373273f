"""Convert grey values that encode dB, and check OCT intensity for its scale."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from kernels.arrays import FloatArray
from registration.errors import ScanFileError
from registration.files.readers.common import Array, empty
from registration.json_ready import is_number
from registration.scan import CountLine

# Speckle tells the two scales apart: its spread in a small place grows with the place's brightness
# where intensity is linear (equal to it for one look) and stays the same in dB (5.57 dB for one
# look: 10 / ln 10 × π / √6, of an exponential law); its skewness is positive (2 / √looks) where
# linear, negative in dB (-1.14). J. W. Goodman, Speckle Phenomena in Optics, 2nd ed., 2020, ch.
# 3-4.
_SIDE = 4
_PLACES = 16
_LEAST_PLACES = 300
_MOST_CUT = 0.05
_SPLIT = 0.5
_SKEW_SPLIT = 0.25
_LEAST_CONTRAST = 1.1
_NOTED_TOP, _MOST_TOP = 0.001, 0.1
_NOTED_BOTTOM, _MOST_BOTTOM = 0.1, 0.8


@dataclass(frozen=True)
class Speckle:
    """Spread of intensity within small places against their brightness.

    Attributes
    ----------
    dark, bright : float
        Median brightness of the darkest and the brightest tenth of places.
    dark_spread, bright_spread : float
        Median standard deviation within those.
    skewness : float
        Median within places.
    """

    dark: float
    bright: float
    dark_spread: float
    bright_spread: float
    skewness: float

    @property
    def growth(self) -> float:
        """Exponent of spread on brightness: 1 for linear intensity, 0 in dB; NaN if unclear."""
        if not (self.dark > 0 and self.bright >= _LEAST_CONTRAST * self.dark):
            return float("nan")
        return float(
            np.log(self.bright_spread / self.dark_spread) / np.log(self.bright / self.dark)
        )

    def __str__(self) -> str:
        return (
            f"it spreads by {self.dark_spread:.3g} in the darkest places (around {self.dark:.3g}) "
            f"and by {self.bright_spread:.3g} in the brightest (around {self.bright:.3g})"
        )


def light_notes(
    volume: Array, known: Mapping[str, Any], asked: bool, path: Path
) -> tuple[str, ...]:
    """What a user should know of an OCT volume's intensity, in the file's own counts.

    Parameters
    ----------
    known : mapping
        Holds ``modality`` and ``scale``.
    asked : bool
        Whether the user named the scale by an option: then a doubt is a note, no refusal.

    Raises
    ------
    ScanFileError
        When too much of the volume lies at an end of its range, or it looks like the other scale.
    """
    places = _sampled(volume)
    if known["modality"] != "oct" or places is None:
        return ()
    notes = _ends(places, known["scale"], path)
    speckle = speckle_of(places)
    doubt = None if speckle is None else _doubt(speckle, known["scale"])
    if doubt and not asked:
        raise ScanFileError(f"{path}: {doubt}")
    return (*notes, *([doubt] if doubt else []))


def _sampled(volume: Array) -> FloatArray | None:
    """Cubes of voxels spread evenly, one a row; None where there is no room for enough."""
    corners = [
        np.unique(np.linspace(0, max(0, size - _SIDE), min(_PLACES, size // _SIDE)).astype(int))
        for size in volume.shape
    ]
    if int(np.prod([len(along) for along in corners])) < _LEAST_PLACES:
        return None
    cubes = [
        volume[z : z + _SIDE, y : y + _SIDE, x : x + _SIDE].astype(np.float64).ravel()
        for z in corners[0]
        for y in corners[1]
        for x in corners[2]
    ]
    return np.array(cubes)


def speckle_of(places: FloatArray) -> Speckle | None:
    """Speckle in places with few counts at an end of the range; None where there are too few."""
    cut = ((places == places.min()) | (places == places.max())).mean(axis=1)
    kept = places[cut <= _MOST_CUT]
    spread = kept.std(axis=1) if len(kept) else np.zeros(0)
    kept, spread = kept[spread > 0], spread[spread > 0]
    if len(kept) < _LEAST_PLACES:
        return None
    means = kept.mean(axis=1)
    skewness = ((kept - means[:, None]) ** 3).mean(axis=1) / spread**3
    order, tenth = np.argsort(means), len(kept) // 10
    dark, bright = order[:tenth], order[-tenth:]
    return Speckle(
        float(np.median(means[dark])),
        float(np.median(means[bright])),
        float(np.median(spread[dark])),
        float(np.median(spread[bright])),
        float(np.median(skewness)),
    )


def _doubt(speckle: Speckle, scale: str) -> str | None:
    """Why the intensity looks like the other scale, and what to give; None where it doesn't."""
    if scale == "linear" and speckle.growth < _SPLIT and speckle.skewness < _SKEW_SPLIT:
        return (
            f"intensity is said to be linear but looks like dB: {speckle}; linear speckle would "
            "grow with brightness. Give --scale db (integers: --db-range LOW,HIGH), or --scale "
            "linear if it is"
        )
    if scale == "db" and speckle.growth > _SPLIT and speckle.skewness > _SKEW_SPLIT:
        return (
            f"intensity is said to be dB but looks linear: {speckle}; in dB speckle spreads alike "
            "everywhere. Give --scale linear, or --scale db if it is"
        )
    return None


def _ends(places: FloatArray, scale: str, path: Path) -> tuple[str, ...]:
    """Shares of voxels at the largest and the smallest number.

    A share q of speckle cut at the top lowers its mean by q (an exponential law cut at c:
    1 - exp(-c / mean)); cut at the bottom it raises it by -ln(1 - q) - q: 0.5 % at 10 %, 80 % at
    80 %.
    """
    least, most = float(places.min()), float(places.max())
    if least == most:
        raise ScanFileError(f"{path}: every voxel that was looked at is {least:g}; scan again")
    top, bottom = float((places == most).mean()), float((places == least).mean())
    if top + bottom == 1:
        raise ScanFileError(
            f"{path}: holds two values only, {least:g} and {most:g}: it is a segmented image; give "
            "the scan as it was before that"
        )
    notes = []
    if top > _MOST_TOP:
        raise ScanFileError(
            f"{path}: {100 * top:.2g} % of its voxels are saturated at {most:g} (limit "
            f"{100 * _MOST_TOP:g} %): walls can't be placed; scan with less light, or export "
            "with a wider window"
        )
    if top > _NOTED_TOP:
        notes.append(
            f"{100 * top:.2g} % of voxels are saturated at {most:g}: where that is in the gel, its "
            "brightness is read too low by about the share there"
        )
    if scale == "db" and bottom > _MOST_BOTTOM:
        raise ScanFileError(
            f"{path}: {100 * bottom:.2g} % of its voxels lie at the lowest number, {least:g} "
            f"(limit {100 * _MOST_BOTTOM:g} %); export with a window that reaches lower"
        )
    if scale == "db" and bottom > _NOTED_BOTTOM:
        notes.append(
            f"{100 * bottom:.2g} % of voxels lie at the lowest number, {least:g}: the noise floor "
            "is cut off, and dark liquid is read too bright"
        )
    return tuple(notes)


COUNT_KEYS = ("db_range", "count_range", "counts_per_db", "db_at_zero")
"""What can be said of counts, by the names of `ScanOverrides`."""
_MOST_DB = 1000.0
_MOST_SPAN_DB = 200.0
_SLAB_VOXELS = 1 << 24


def layered(*layers: Mapping[str, Any]) -> dict[str, object]:
    """Merge descriptions of a scan, later ones first; grey values described by one of them."""
    known: dict[str, object] = {}
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
    if not (is_number(slope) and slope > 0):
        raise ScanFileError(f"{path}: counts_per_db is {slope!r}; it must be a number above 0")
    if not (is_number(offset) and abs(offset) <= _MOST_DB):
        raise ScanFileError(f"{path}: db_at_zero is {offset!r}; it must be dB within ± {_MOST_DB}")
    return CountLine(float(slope), float(offset))


def _pair(value: Any, name: str, path: Path) -> tuple[float, float]:
    if isinstance(value, list | tuple) and len(value) == 2:
        low, high = value
        if is_number(low) and is_number(high) and low < high:
            return float(low), float(high)
    raise ScanFileError(f"{path}: {name} is {value!r}; it must be two numbers, the lower one first")


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
