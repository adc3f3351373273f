"""Calibration pattern that ties a camera to the printer: nested squares, four lines around them."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from printctl.calibration.patterns.plan import Bead, Pattern, Stroke, straight
from printctl.errors import UsageError

_OUTERMOST: Final = 0.9
"""Place of the lines beyond the squares, over the circle's radius."""
_INNERMOST: Final = 0.2
_APART: Final = (4.8, 0.2)
"""Between parallel lines: at least mm, so that each is alone within 2 mm of where it is looked for;
and over the radius."""
_LEAST_MM: Final = 16.0


def squares_pattern(bead: Bead, across_mm: float, speed_mm_s: float) -> Pattern:
    """Squares in a circle, and a line beyond each side: straight lines that don't meet.

    Each line of ink lies off by some 20 µm of its own, so what a camera is tied to by four sides of
    a small square is off by that, and by more where it is prolonged. Sixteen lines (fewer in a
    small dish) as far apart as the dish lets them bring it below that everywhere in the dish.

    Parameters
    ----------
    across_mm : float, mm
        Diameter of the circle.

    Raises
    ------
    UsageError
        For a circle so small that lines would touch.
    """
    if not math.isfinite(across_mm) or across_mm < _LEAST_MM:
        raise UsageError(
            f"--across {across_mm:g} mm leaves lines no room to be told apart; give "
            f"{_LEAST_MM:g} mm or more, as far as the dish lets the needle go"
        )
    radius = across_mm / 2
    away, apart = _OUTERMOST * radius, max(_APART[0], _APART[1] * radius)
    halves = np.arange(away - apart, _INNERMOST * radius, -apart)
    strokes = [_square(radius, half, speed_mm_s) for half in halves[::-1].tolist()]
    half = away * math.sqrt(1 - _OUTERMOST**2)
    for turn in range(4):
        ends = np.array([[away, -half], [away, half]]) @ _quarter(turn) + radius
        strokes.append(straight(0, "side", [(x, y) for x, y in ends.tolist()], speed_mm_s))
    return Pattern("squares", bead, (across_mm, across_mm), tuple(strokes))


def _square(radius: float, half: float, speed_mm_s: float) -> Stroke:
    corners = [(-half, half), (-half, -half), (half, -half), (half, half), (-half, half)]
    return straight(0, "side", [(radius + x, radius + y) for x, y in corners], speed_mm_s)


def _quarter(turns: int) -> np.ndarray:
    """Rotation by quarter turns, (2, 2), exact."""
    return np.linalg.matrix_power(np.array([[0.0, 1.0], [-1.0, 0.0]]), turns)
