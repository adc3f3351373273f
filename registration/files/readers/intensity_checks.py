"""Check OCT intensity for saturation, and by its speckle for dB taken as linear or the reverse.

Speckle tells the two scales apart: its spread in a small place grows with the place's brightness
where intensity is linear (equal to it for one look) and stays the same in dB (5.57 dB for one
look: 10 / ln 10 × π / √6, of an exponential law); its skewness is positive (2 / √looks) where
linear, negative in dB (-1.14). J. W. Goodman, Speckle Phenomena in Optics, 2nd ed., 2020, ch. 3-4.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from registration.errors import ScanFileError
from registration.files.readers.raw_result import Array

_SIDE = 4
_PLACES = 16
_LEAST_PLACES = 300
_MOST_CUT = 0.05
_SPLIT = 0.5
_SKEW_SPLIT = 0.25
_LEAST_CONTRAST = 1.1
_NOTED_TOP, _MOST_TOP = 0.001, 0.1
_NOTED_BOTTOM, _MOST_BOTTOM = 0.1, 0.8

Floats = NDArray[np.float64]


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


def _sampled(volume: Array) -> Floats | None:
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


def speckle_of(places: Floats) -> Speckle | None:
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


def _ends(places: Floats, scale: str, path: Path) -> tuple[str, ...]:
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
