"""How far a layer lies beside its place: where its lines explain most of the picture.

For every shift the ink's profile is fitted anew, by least squares over all pixels: the sums that
this takes are correlations of the picture with maps of distance, found for all shifts at once by
Fourier's transform.

A profile that may have even and odd parts fits at any small shift: to first order a shift *is* an
odd part. So ink is taken to be even (a level, a shade, rims) or odd (slopes lit from one side), by
which of both explains more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import fft

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.passes import REACH, Passes
from registration.inspection.values import FloatImage

_NODES: Final = 8
"""Of a profile, here."""
_USUAL_MM: Final = 0.03
"""Scale of a print's own shift (Student's t): a peak at the designed place, with long tails."""
_CELL: Final = 0.5
"""Of a width: pixels nearer to each other tell the same."""
_RIDGE: Final = 1e-3


@dataclass(frozen=True)
class CoarseShift:
    """Where a layer lies, about.

    Attributes
    ----------
    by_px : (2,) float64, px
        x and y.
    odd : bool
        Whether its ink shows by slopes that are lit from one side.
    """

    by_px: FloatArray
    odd: bool


def coarse_shift(
    image: FloatImage,
    lost: BoolArray,
    passes: Passes,
    kind: IntArray,
    width_px: float,
    most_px: float,
    px_per_mm: float,
) -> CoarseShift:
    """Return the likeliest shift.

    Parameters
    ----------
    image : (h, w, c) float32
        Without light, ground and older ink; noise of the ground 1.
    lost : (h, w) bool
    passes : Passes
        At the designed place.
    kind : (n,) int64
        Of each piece, 0 fresh.
    width_px, most_px : float, px
        Of a line; farthest shift.
    px_per_mm : float
    """
    even, odd = _maps(passes, kind)
    far = max(1, math.ceil(most_px))
    shape = tuple(fft.next_fast_len(n + 2 * far, real=True) for n in image.shape[:2])
    seen = [
        fft.rfft2(np.where(lost, np.float32(0.0), image[:, :, c]), shape)
        for c in range(image.shape[2])
    ]
    cell = max(1.0, (_CELL * width_px) ** 2)
    by = np.arange(-far, far + 1)
    away = np.hypot(*np.meshgrid(by, by))
    prior = -1.5 * np.log1p((away / (_USUAL_MM * px_per_mm)) ** 2)
    prior[away > most_px] = -np.inf
    scores = [_scores(seen, maps, by, shape) for maps in (even, odd)]
    both = 0.5 * _explained(np.concatenate(scores, axis=1), even + odd) / cell + prior
    best = []
    for score, maps in zip(scores, (even, odd), strict=True):
        log = 0.5 * _explained(score, maps) / cell + prior
        row, column = np.unravel_index(int(np.argmax(log)), log.shape)
        best.append((float(both[row, column]), log, int(row), int(column)))
    is_odd = best[1][0] > best[0][0]
    _, log, row, column = best[is_odd]
    place = np.array([_finer(log[row], column), _finer(log[:, column], row)]) - far
    return CoarseShift(place, is_odd)


def _scores(
    seen: list[FloatArray], maps: list[FloatImage], by: IntArray, shape: tuple[int, ...]
) -> FloatArray:
    """Correlation of each channel with each map at each shift, (c, m, dy, dx)."""
    spectra = [np.conj(fft.rfft2(one, shape)) for one in maps]
    window = np.ix_(by, by)
    return np.array([[fft.irfft2(one * each, shape)[window] for each in spectra] for one in seen])


def _explained(scores: FloatArray, maps: list[FloatImage]) -> FloatArray:
    """Sum of squares that a profile of these maps explains at each shift, (dy, dx)."""
    flat = np.stack(maps).reshape(len(maps), -1).astype(np.float64)
    power = flat @ flat.T
    power += _RIDGE * max(float(np.trace(power)) / len(maps), 1e-9) * np.eye(len(maps))
    solved = np.einsum("ij,cjyx->ciyx", np.linalg.inv(power), scores)
    return np.asarray((scores * solved).sum(axis=(0, 1)))


def _maps(passes: Passes, kind: IntArray) -> tuple[list[FloatImage], list[FloatImage]]:
    """Even and odd functions of distance to fresh lines, (h, w) each."""
    fresh = np.append(kind == 0, False)[passes.piece] & (np.abs(passes.distance) < REACH)
    at = np.abs(passes.distance) * (_NODES / REACH)
    sign = np.where(passes.distance < 0, np.float32(-1.0), np.float32(1.0))
    even, odd = [], []
    for j in range(_NODES):
        hat = np.where(fresh, np.maximum(1.0 - np.abs(at - j), 0.0), 0.0).astype(np.float32)
        even.append(hat.sum(axis=2))
        if j:
            odd += [(hat * sign * passes.turn[..., k]).sum(axis=2) for k in range(2)]
    return even, odd


def _finer(values: FloatArray, k: int) -> float:
    """Where a parabola through the highest of values and its neighbours is highest."""
    if k == 0 or k == len(values) - 1 or not np.isfinite(values[[k - 1, k + 1]]).all():
        return float(k)
    low, top, high = values[k - 1 : k + 2]
    bend = low - 2.0 * top + high
    return float(k + 0.5 * (low - high) / bend) if bend < -1e-12 else float(k)
