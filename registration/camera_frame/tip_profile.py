"""Place a needle of known width in the mean profile across it."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

FloatArray = NDArray[np.float64]

_FINE: Final = 10
"""Samples a pixel."""
_HATS: Final = 9
"""Of which the needle's own brightness across is made."""
_BLURS: Final = (0.6, 0.8, 1.0, 1.3, 1.7, 2.2, 3.0)
_REACH: Final = 1.6
_FAULT: Final = 0.012
"""Of the model, of the profile's range: no rod is lit quite so smoothly."""
_SMOOTH: Final = 0.02
"""Weight of the second differences of brightness across, against a jump of the same size."""


def profile_middle(
    profile: FloatArray, first: float, wide_px: float
) -> tuple[float, float | None, float]:
    """Column of the needle's axis; its width, or None where the profile doesn't tell; uncertainty.

    The profile is taken as ground to the left and right, and between them a rod of the known width
    whose brightness is any smooth curve, all blurred: gradients alone move with the shade of its
    rims. The curve is solved for at each place tried; the place with the least rest is taken.

    Parameters
    ----------
    profile : (m,) float64
        Mean brightness along the needle.
    first : float
        Column to begin with, right to some pixels.
    wide_px : float

    Notes
    -----
    The uncertainty is half the stretch of places that explain the profile nearly as well.
    """
    reach = max(1.5, 0.2 * wide_px)
    tried = first + np.arange(-reach, reach + 0.05, 0.1)
    columns = np.arange(
        max(0, int(first - _REACH * wide_px)), min(len(profile), int(first + _REACH * wide_px) + 1)
    )
    part = profile[columns]
    rest = np.array([[_rest(part, columns, at, wide_px, blur) for at in tried] for blur in _BLURS])
    own = rest[int(rest.min(axis=1).argmin())]
    best = int(own.argmin())
    if not 0 < best < len(own) - 1:
        return first, None, reach
    middle = _least(tried, own)
    blur = _BLURS[int(rest.min(axis=1).argmin())]
    widths = wide_px * np.arange(0.85, 1.16, 0.015)
    by_width = np.array([_rest(part, columns, middle, wide, blur) for wide in widths])
    if not 0 < int(by_width.argmin()) < len(widths) - 1:
        return middle, None, _vague(tried, own, len(part))
    return middle, _least(widths, by_width), _vague(tried, own, len(part))


def _vague(tried: FloatArray, rest: FloatArray, count: int) -> float:
    """Half of the stretch of places that explain the profile nearly as well, px.

    Where both rims are as bright as the ground, no edge says where the needle ends.
    """
    good = tried[rest <= 2 * rest.min() + _FAULT**2 * count]
    return float(good.max() - good.min()) / 2


def _least(tried: FloatArray, rest: FloatArray) -> float:
    """Where a parabola through the least and its neighbours is least."""
    best = int(rest.argmin())
    a, b, c = rest[best - 1 : best + 2]
    bend = a - 2 * b + c
    step = float(tried[1] - tried[0])
    return float(tried[best] + (step / 2 * (a - c) / bend if bend > 0 else 0.0))


def _rest(
    part: FloatArray, columns: NDArray[np.int64], at: float, wide_px: float, blur: float
) -> float:
    """Sum of squares that the best brightness across leaves."""
    shapes = _shapes(np.asarray(columns - at, dtype=np.float64), wide_px, blur)
    scale = float(np.ptp(part)) or 1.0
    bend = np.zeros((_HATS - 2, _HATS + 2))
    for n in range(_HATS - 2):
        bend[n, 2 + n : 5 + n] = [1.0, -2.0, 1.0]
    terms = np.vstack([shapes, _SMOOTH * bend * np.sqrt(len(part))])
    right = np.concatenate([part / scale, np.zeros(_HATS - 2)])
    solved = np.linalg.lstsq(terms, right, rcond=None)[0]
    return float(((terms @ solved - right) ** 2).sum())


def _shapes(beside: FloatArray, wide_px: float, blur: float) -> FloatArray:
    """Blurred ground left, right, and hats across the needle, at columns, (k, 2 + hats)."""
    fine = np.arange(beside[0] - 6, beside[-1] + 6, 1 / _FINE)
    knots = np.linspace(-1, 1, _HATS) * wide_px / 2
    within = np.abs(fine) <= wide_px / 2
    shapes = [(fine < -wide_px / 2), (fine > wide_px / 2)]
    step = knots[1] - knots[0]
    shapes += [np.where(within, np.clip(1 - np.abs(fine - k) / step, 0, 1), 0.0) for k in knots]
    blurred = gaussian_filter1d(np.array(shapes, dtype=float), blur * _FINE, axis=1)
    return np.array([np.interp(beside, fine, row) for row in blurred]).T
