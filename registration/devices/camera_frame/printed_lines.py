"""Find printed straight lines in a picture, and the pixels where they cross."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from kernels.arrays import FloatArray
from registration.devices.camera_frame.bundle import PrintedPoints
from registration.devices.camera_frame.frame import View, bend, project, unbend
from registration.devices.camera_frame.marks import grey_picture
from registration.errors import PictureError

_ROWS: Final = 160
"""Profiles across a line."""
_ENDS: Final = 0.08
_TURN: Final = 0.06
_TURN_STEP_MM: Final = 0.075
"""Largest slope against the expected direction that is tried, and steps of a line's end."""
_LEAST_CLEAR: Final = 6.0
"""Of the best place's response over the deviation of the others."""
_LEAST_GOOD: Final = 0.5
"""Of a line's length on which it must be seen."""
_STRETCHES: Final = 10
_SQUARE: Final = 0.3
"""Sine of the smallest angle between two lines whose crossing counts."""


@dataclass(frozen=True)
class PrintedLine:
    """A straight line of the G-code.

    Attributes
    ----------
    begin, end : (x, y, z), mm
        Printer's frame.
    width_mm : float, mm
    """

    begin: tuple[float, float, float]
    end: tuple[float, float, float]
    width_mm: float


def find_crossings(
    image: NDArray[Any],
    view: View,
    lines: Sequence[PrintedLine],
    *,
    reach_mm: float = 2.5,
    u_mm: float = 0.02,
) -> PrintedPoints:
    """Find the lines, and where they (or their prolongations) cross.

    Parameters
    ----------
    image : (h, w) or (h, w, 3)
    view : View
        The camera in the printer's frame, as far as it is known: right to ``reach_mm`` and 3°.
    lines : sequence of PrintedLine
    reach_mm : float, mm
        How far off a line is looked for; nothing like it may lie as near.
    u_mm : float, mm
        How well ink lies where the motors went, each line by itself.

    Raises
    ------
    PictureError
        When a line isn't seen, or fewer than two crossings are left.
    """
    grey = grey_picture(image)
    flat, known = [], []
    for number, line in enumerate(lines, 1):
        ends, sure = _found(grey, view, line, reach_mm, number)
        flat.append(unbend((ends - view.lens[1:3]) / view.lens[0], view.lens))
        known.append(sure)
    places, pixels, spread, pairs = [], [], [], []
    for one, other in combinations(range(len(lines)), 2):
        place = _meeting(_plan(lines[one]), _plan(lines[other]))
        pixel = _meeting(flat[one], flat[other])
        if place is None or pixel is None:
            continue
        places.append([*place, (lines[one].begin[2] + lines[other].begin[2]) / 2])
        pixels.append(bend(pixel[None], view.lens)[0] * view.lens[0] + view.lens[1:3])
        off = [_spread(_plan(lines[n]), place, known[n]) for n in (one, other)]
        spread.append(float(np.sqrt(u_mm**2 + (off[0] ** 2 + off[1] ** 2) / 2)))
        pairs.append((one, other))
    if len(places) < 2:
        raise PictureError(
            f"the {len(lines)} printed lines cross in {len(places)} places (2 wanted); print two "
            "lines along x and two along y, far apart"
        )
    # Crossings of one line share its error: taken as independent, each must count for less.
    crossed = np.bincount(np.ravel(pairs))[np.array(pairs)].mean(axis=1)
    return PrintedPoints(np.array(places), np.array(pixels), np.array(spread) * np.sqrt(crossed))


def _plan(line: PrintedLine) -> FloatArray:
    return np.array([line.begin[:2], line.end[:2]])


def _spread(line: FloatArray, place: FloatArray, sure: tuple[float, float]) -> float:
    """Uncertainty across a line where it, or its prolongation, passes a place, mm."""
    along = line[1] - line[0]
    share = float((place - line[0]) @ along / (along @ along))
    return float(np.hypot(sure[0], sure[1] * (share - 0.5)))


def _meeting(one: FloatArray, other: FloatArray) -> FloatArray | None:
    """Where the lines through two pairs of points meet; None where they are nearly parallel."""
    a, b = one[1] - one[0], other[1] - other[0]
    turn = float(a[0] * b[1] - a[1] * b[0])
    if abs(turn) < _SQUARE * float(np.linalg.norm(a) * np.linalg.norm(b)):
        return None
    apart = other[0] - one[0]
    return np.asarray(one[0] + (apart[0] * b[1] - apart[1] * b[0]) / turn * a)


def _found(
    grey: NDArray[np.float32], view: View, line: PrintedLine, reach_mm: float, number: int
) -> tuple[FloatArray, tuple[float, float]]:
    """Pixels of the line's two ends on its axis (2, 2); uncertainty of its middle and slope, mm."""
    begin, end = np.array(line.begin), np.array(line.end)
    along = end - begin
    across = np.array([-along[1], along[0], 0.0]) / np.hypot(*along[:2])
    share = np.linspace(_ENDS, 1 - _ENDS, _ROWS)
    step = max(line.width_mm / 10, 0.004)
    aside = np.arange(-reach_mm, reach_mm + step, step)
    places = begin + share[:, None, None] * along + aside[:, None] * across
    pixels = project(view, places.reshape(-1, 3)).astype(np.float32).reshape(*places.shape[:2], 2)
    strip = cv2.remap(grey, pixels[..., 0], pixels[..., 1], cv2.INTER_CUBIC,
                      borderMode=cv2.BORDER_REPLICATE)  # fmt: skip
    ridge = _ridges(strip.astype(np.float64), line.width_mm / step)
    at, slope, clear, sign = _best(ridge, share, aside, float(np.hypot(*along[:2])))
    if clear < _LEAST_CLEAR:
        raise PictureError(
            f"printed line {number} isn't seen within {reach_mm:g} mm of where it should lie "
            f"({clear:.1f} times the ground's deviation, {_LEAST_CLEAR:g} wanted): is the fiducial "
            "plate where --at says, to 2 mm and 3 degrees? Dye the ink, light it evenly"
        )
    middle, lean, sure = _refined(sign * ridge, share, aside, (at, slope), line.width_mm, number)
    off = middle + lean * (np.array([0.0, 1.0]) - 0.5)
    ends = np.array([begin, end]) + off[:, None] * across
    return project(view, ends), sure


def _ridges(strip: FloatArray, width: float) -> FloatArray:
    """Response of each row to a line of a width (samples): narrow mean less a wide one."""
    ground = np.median(strip, axis=1, keepdims=True)
    near = gaussian_filter1d(strip - ground, 0.4 * width, axis=1)
    return np.asarray(near - gaussian_filter1d(strip - ground, 1.2 * width, axis=1))


def _best(
    ridge: FloatArray, share: FloatArray, aside: FloatArray, length_mm: float
) -> tuple[float, float, float, float]:
    """Offset in the middle and slope (mm over the length) of the clearest line; how clear; sign."""
    columns, step = np.arange(ridge.shape[1]), aside[1] - aside[0]
    most = (0.0, 0.0, 0.0, 0.0)
    half = math.ceil(_TURN * length_mm / _TURN_STEP_MM)
    for turn in _TURN_STEP_MM * np.arange(-half, half + 1):
        shift = (share - 0.5) * turn / step
        base = np.floor(shift).astype(np.int64)
        part = shift - base
        index = np.clip(columns + base[:, None], 0, ridge.shape[1] - 2)
        rows = np.arange(len(ridge))[:, None]
        sheared = (1 - part[:, None]) * ridge[rows, index] + part[:, None] * ridge[rows, index + 1]
        mean = sheared.mean(axis=0)
        best = int(np.abs(mean).argmax())
        noise = 1.4826 * float(np.median(np.abs(mean - np.median(mean)))) + 1e-9
        clear = abs(float(mean[best])) / noise
        strength = abs(float(mean[best]))
        if strength > abs(most[3]):
            most = (float(aside[best]), float(turn), clear, float(mean[best]))
    return most[0], most[1], most[2], float(np.sign(most[3]))


def _refined(
    ridge: FloatArray,
    share: FloatArray,
    aside: FloatArray,
    first: tuple[float, float],
    width: float,
    number: int,
) -> tuple[float, float, tuple[float, float]]:
    """Offset in the middle, slope, and their uncertainties by each row's centre, mm."""
    at, slope = first
    for _ in range(3):
        want = at + slope * (share - 0.5)
        near = np.abs(aside - want[:, None]) < 1.2 * width
        weight = np.where(near, np.clip(ridge, 0, None), 0.0)
        total = weight.sum(axis=1)
        centre = (weight * aside).sum(axis=1) / np.maximum(total, 1e-12)
        good = total > 0.35 * np.median(total)
        for _ in range(4):
            line = np.polyfit(share[good] - 0.5, centre[good], 1)
            off = centre - np.polyval(line, share - 0.5)
            usual = 1.4826 * float(np.median(np.abs(off[good]))) + 1e-6
            good = (total > 0.35 * np.median(total)) & (np.abs(off) < 3 * usual)
        slope, at = map(float, line)
    if good.mean() < _LEAST_GOOD:
        raise PictureError(
            f"printed line {number} is seen on {good.mean():.0%} of its length "
            f"({_LEAST_GOOD:.0%} wanted); print it again, or leave it out"
        )
    return at, slope, _uncertain(off[good], share[good] - 0.5)


def _uncertain(off: FloatArray, along: FloatArray) -> tuple[float, float]:
    """Standard uncertainties of middle and slope, mm, by the means of stretches.

    Rows beside each other see the same grain of the bath; stretches are nearly independent.
    """
    parts = np.array_split(np.arange(len(off)), _STRETCHES)
    means = np.array([off[part].mean() for part in parts])
    places = np.array([along[part].mean() for part in parts])
    scatter = float(np.sqrt((means**2).sum() / (_STRETCHES - 2)))
    return scatter / float(np.sqrt(_STRETCHES)), scatter / float(np.linalg.norm(places))
