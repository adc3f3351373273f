"""Image model of a needle's end: a blurred rod's coverage and brightness at each pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import ndtr

from kernels.arrays import FloatArray

_FINE: Final = 4
"""Samples a pixel across."""
_MAX_BLUR_DEVIATIONS: Final = 4.5
"""Deviations of the blur beyond which nothing of it is left."""
_SLOPES: Final = 3
"""Hats of which the brightness's change along the needle is made."""
_HAT_PX: Final = 0.8
_MOST_HATS: Final = 60


@dataclass(frozen=True)
class RodEnd:
    """What is fitted of a needle's end.

    Attributes
    ----------
    end : float, px
        Height of the middle of the end's ellipse.
    tilt : float, px
        By which the end is higher at its right rim than in its middle.
    blur : float, px
        Deviation of the blur.
    wide : float, px
        Width at the end.
    """

    end: float
    tilt: float
    blur: float
    wide: float


@dataclass(frozen=True, eq=False)
class Lattice:
    """Where the model is wanted.

    Attributes
    ----------
    heights : (k,) float64, px
        Up the needle.
    beside : (m,) float64, px
        From its axis, at the end's distance from the camera.
    bow : float
        How far the end's ellipse reaches below its middle, of the width.
    """

    heights: FloatArray
    beside: FloatArray
    bow: float


def hat_count(wide: float) -> int:
    """How many hats the brightness across is made of; fewer shift the needle to fit its glare."""
    return int(np.clip(round(wide / _HAT_PX), 7, _MOST_HATS))


class RodModel:
    """The rod's share of each pixel, and its brightness as a sum of smooth shapes.

    Notes
    -----
    Light is a product of the brightness B(x) across and of a step along, both blurred by a Gauss
    function of deviation b: I(u, h) = ∫ B(x) g((u - x) / b) Φ((h - e(x)) / b) dx, with the end
    e(x) = end + tilt 2 x / w - bow √(1 - (2 x / w)²), the lower half of the ellipse that a flat
    end shows. Blur along the curved end is then right, too: an area under a step isn't.
    """

    def __init__(self, rod: RodEnd, lattice: Lattice, count: int, aside: float = 0.0) -> None:
        half = rod.wide / 2
        steps = max(8, int(np.ceil(rod.wide * _FINE)))
        x = (np.arange(steps) + 0.5) / steps * rod.wide - half
        share = x / half
        end = rod.end + rod.tilt * share - lattice.bow * rod.wide * np.sqrt(1 - share**2)
        self.step = ndtr((lattice.heights[:, None] - end) / rod.blur)
        off = (lattice.beside[:, None] - aside - x) / rod.blur
        near = np.where(np.abs(off) < _MAX_BLUR_DEVIATIONS, np.exp(-(off**2) / 2), 0.0)
        self.across = near * (rod.wide / steps / (rod.blur * np.sqrt(2 * np.pi)))
        self.hats = _hats(share, count)
        self.few = _hats(share, _SLOPES)
        self.up = (lattice.heights - rod.end)[:, None] / rod.wide

    def cover(self) -> FloatArray:
        """Share of the rod (k, m)."""
        return np.asarray(self.step @ self.across.T)

    def light(self, levels: FloatArray) -> FloatArray:
        """Light of the rod (k, m) by the levels of all its shapes."""
        count = len(self.hats)
        plain = (self.step * (levels[:count] @ self.hats)) @ self.across.T
        lean = (self.step * (levels[count:] @ self.few)) @ self.across.T
        return np.asarray(plain + self.up * lean)

    def shapes(self) -> FloatArray:
        """Light of each shape at level 1, (hats + 3, k, m)."""
        plain = [self._shape(hat) for hat in self.hats]
        lean = [self.up * self._shape(hat) for hat in self.few]
        return np.array([*plain, *lean])

    def _shape(self, hat: FloatArray) -> FloatArray:
        within = np.flatnonzero(hat)
        part = slice(within[0], within[-1] + 1)
        return np.asarray((self.step[:, part] * hat[part]) @ self.across[:, part].T)


def _hats(share: FloatArray, count: int) -> FloatArray:
    """Hats over -1 to 1 whose sum is 1, (count, n)."""
    knots = np.linspace(-1, 1, count)
    return np.maximum(0.0, 1 - np.abs(share - knots[:, None]) / (knots[1] - knots[0]))
