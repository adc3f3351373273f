"""Data types of a calibration fit: measured widths and answers; values and profile changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from printctl.calibration.estimate import Estimate

END: Final = 0.93
"""Of a line's length: beyond lies what its end does."""


@dataclass(frozen=True)
class Change:
    """A key of the ink's profile.

    Attributes
    ----------
    value : Any
        As the profile holds it.
    said : str
        For its source: the number with its interval.
    """

    value: Any
    said: str


@dataclass(frozen=True)
class Answer:
    """Result of a calibration pattern.

    Attributes
    ----------
    estimates : dict of str to Estimate
    table : list of str
        Line by line, for people.
    notes : list of str
        What it means, and what this print can't tell.
    changes : dict of str to Change
        Keys of the ink's profile.
    """

    estimates: Mapping[str, Estimate] = field(default_factory=dict)
    table: Sequence[str] = ()
    notes: Sequence[str] = ()
    changes: Mapping[str, Change] = field(default_factory=dict)


@dataclass(frozen=True)
class Widths:
    """Measured widths along strokes.

    Attributes
    ----------
    number : (n,) int64
        Stroke of each.
    x_mm, width_mm : (n,) float64, mm
        Way from the stroke's begin, and width there.
    last_digit_mm : float, mm
        Of a typed width.
    found : dict of int to float
        Share of each stroke at which a picture shows ink; empty of typed widths.
    optics : float
        Half of the relative 95 % interval of all widths, from what a picture's edges mean.
    """

    number: NDArray[np.int64]
    x_mm: FloatArray
    width_mm: FloatArray
    last_digit_mm: float = 0.0
    found: Mapping[int, float] = field(default_factory=dict)
    optics: float = 0.0

    def of(self, number: int) -> tuple[FloatArray, FloatArray]:
        """Places and widths of one stroke."""
        rows = self.number == number
        return self.x_mm[rows], self.width_mm[rows]


@dataclass(frozen=True)
class Replies:
    """A number for each question: a gap in mm, 0 where closed; or 1 for held, 0 for not.

    Attributes
    ----------
    number : (n,) int64
    reply : (n,) float64
    part : (n,) float64
        Share of the ways across that are open; of typed ones 0 or 1.
    least_mm : float, mm
        Narrower gaps can't be seen in the picture; 0 of typed ones.
    """

    number: NDArray[np.int64]
    reply: FloatArray
    part: FloatArray
    least_mm: float = 0.0
