"""Shading of beads' ridges that are lit from the side.

A bead's surface is brighter where it slopes to the light and darker where it slopes away, so that
brightness (logarithm, over the bath) at a place is, with d its distance from the nearest line's
middle in widths and a the direction to it from there in the picture,

    m(d, a) = m0(d) + m1(d) cos a + m2(d) sin a,

each a function of d alone: Lambert's law for a small slope, whatever the bead's section. Ends and
turns follow from the nearest line, as the height of beads that run into each other does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels import jit
from kernels.arrays import FloatArray
from registration.inspection.ink.ink_image import ACROSS
from registration.inspection.ridges.ridge_axes import Axes, Stretch, nearest_axis
from registration.inspection.values import Shift

KNOTS: Final = np.linspace(0.0, 0.72, 7)
"""Widths from a line's middle; beyond the last lies bath. Blur carries light over the edge."""
_TERMS: Final = 16
"""Knots of m0, and those of m1 and m2 without their first."""
_CENTRE: Final = 0.4
"""Weight of the middle one of the points that stand for blur."""
_AROUND: Final = np.array([(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
_WEIGHTS: Final = np.array([_CENTRE, *[0.25 * (1.0 - _CENTRE)] * 4])


@dataclass(frozen=True)
class RidgeLight:
    """Shading of ridges, and the layer's shift by it.

    Attributes
    ----------
    terms : (3, 7) float64
        m0, m1, m2 at `KNOTS`.
    level : float
        Of the bath.
    channels : slice
        Those of the picture whose mean it describes.
    to_picture : (2, 2) float64, px/mm
    axes : Axes
    width_mm : float, mm
    blur_mm : float, mm
        Standard deviation of the picture's blur, which smooths creases where beads meet.
    shift : Shift
    """

    terms: FloatArray
    level: float
    channels: slice
    to_picture: FloatArray
    axes: Axes
    width_mm: float
    blur_mm: float
    shift: Shift

    @property
    def slant(self) -> float:
        """Root of the power of the odd part over that of the even one."""
        return slant_of(self.terms)

    def shade(self, at: FloatArray, without: Stretch) -> FloatArray:
        """Brightness over the bath at places (k, 2), mm, without a stretch of each one's line."""
        basis = blurred_basis(self.axes, at, without, self.to_picture, self.width_mm, self.blur_mm)
        return np.asarray(basis @ _flat(self.terms))

    def across(self) -> FloatArray:
        """m0, m1, m2 over `ACROSS`, (3, 61)."""
        sides = np.stack([np.interp(np.abs(ACROSS), KNOTS, row) for row in self.terms])
        sides[1:] *= np.sign(ACROSS)
        return np.asarray(np.where(np.abs(ACROSS) <= KNOTS[-1], sides, 0.0))


def blurred_basis(
    axes: Axes,
    at: FloatArray,
    without: Stretch,
    to_picture: FloatArray,
    width_mm: float,
    blur_mm: float,
) -> FloatArray:
    """Value of each term's knots (all but the last; the odd ones without the first), (k, 16).

    The mean over five points that have a blur's variance.
    """
    off, weight = (_AROUND, _WEIGHTS) if blur_mm > 0 else (_AROUND[:1], np.ones(1))
    off = blur_mm * np.sqrt(2.0 / (1.0 - _CENTRE)) * off
    return _basis(axes, at, without, to_picture, width_mm, off, weight)


@jit
def _basis(
    axes: Axes,
    at: FloatArray,
    without: Stretch,
    to_picture: FloatArray,
    width_mm: float,
    off: FloatArray,
    weight: FloatArray,
) -> FloatArray:
    """`blurred_basis` of weighted points around each place."""
    inner = len(KNOTS) - 1
    step, reach = width_mm * KNOTS[1], width_mm * KNOTS[-1]
    out = np.zeros((len(at), _TERMS))
    for k in range(len(at)):
        for n in range(len(off)):
            far, x, y = nearest_axis(
                axes, at[k, 0] + off[n, 0], at[k, 1] + off[n, 1], reach,
                without.stroke[k], without.along[k], without.half_mm,
            )  # fmt: skip
            if far > reach:
                continue
            u = to_picture[0, 0] * x + to_picture[0, 1] * y
            v = to_picture[1, 0] * x + to_picture[1, 1] * y
            size = max(np.sqrt(u * u + v * v), 1e-9)
            knot = int(far / step)
            for j in range(knot, min(knot + 2, inner)):
                hat = weight[n] * (1.0 - abs(far / step - j))
                out[k, j] += hat
                if j > 0:
                    out[k, inner + j - 1] += hat * u / size
                    out[k, 2 * inner + j - 2] += hat * v / size
    return out


def _flat(terms: FloatArray) -> FloatArray:
    return np.concatenate([terms[0, :-1], terms[1, 1:-1], terms[2, 1:-1]])


def terms_of(values: FloatArray) -> FloatArray:
    """m0, m1, m2 at `KNOTS`, (3, 7), of coefficients (16,) of `blurred_basis`."""
    inner = len(KNOTS) - 1
    out = np.zeros((3, len(KNOTS)))
    out[0, :-1] = values[:inner]
    out[1:, 1:-1] = values[inner : 3 * inner - 2].reshape(2, inner - 1)
    return out


def slant_of(terms: FloatArray) -> float:
    """Root of odd over even power, as of `Template`."""
    odd, even = float((terms[1:] ** 2).sum()), float((terms[0] ** 2).sum())
    return float(np.sqrt(odd / max(even, 1e-12)))
