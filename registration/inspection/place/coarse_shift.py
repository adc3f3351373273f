"""Estimate a layer's offset in pixels by correlating the picture with its expected line areas.

The contrast between where lines are expected and all else is squared and summed over the picture's
channels, and over the strength of their edges (clear ink shows by its edges alone). Of several good
places the nearest counts: parallel lines fit again one pitch further on. A filled area fits fairly
well everywhere within reach, and best where its outline does: there the best place counts.
"""

from __future__ import annotations

import cv2
import numpy as np

from kernels.arrays import FloatArray
from registration.inspection.pictures.working import Mask, shrunk
from registration.inspection.values import FloatImage

_GOOD = 0.6
"""Of the best score, at which a nearer place is taken."""
_LEAST_SCORE = 0.05
"""A lower best score is chance: texture and noise reach 0.04 without any ink."""
_SURE_SCORE = 0.25
"""From here on a best score tells, though it is no steep peak."""
_PEAK = 1.3
"""Times the middle score that the best of separate lines has at least."""


def coarse_shift(
    flat: FloatImage,
    fresh: Mask,
    blocked: Mask,
    reach_px: tuple[int, int],
    least_spread: float = 0.0,
) -> FloatArray | None:
    """Shift of the picture against the mask, (2,) px; None where nothing tells.

    Parameters
    ----------
    flat : (h, w, c) float32
        Light taken out.
    fresh : (h, w) uint8
        Where lines are expected.
    blocked : (h, w) uint8
        1 where nothing is known.
    reach_px : (x, y)
        Farthest along rows and columns: a profiler's pixels may be three times as wide as high.
    least_spread : float
        Of the bath: ink that stands out by less counts by how much it does.
    """
    shrink = max(1, int(np.sqrt(fresh.size / 2e5)))
    size = (fresh.shape[1] // shrink, fresh.shape[0] // shrink)
    known = 1.0 - cv2.resize(blocked.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    lines = cv2.resize(fresh.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    x, y = (max(1, one // shrink) for one in reach_px)
    reach = (x, y)
    padded = (lines.shape[0] + 2 * y, lines.shape[1] + 2 * x)
    shape = tuple(cv2.getOptimalDFTSize(int(n)) for n in padded)
    mask = np.conj(np.fft.rfft2(lines, shape))
    ones = _window(np.fft.irfft2(np.fft.rfft2(known, shape) * mask, shape), reach)
    total = float(known.sum())
    score = np.zeros_like(ones)
    for values in _features(flat, size):
        middle = float(np.median(values))
        spread = 1.4826 * float(np.median(np.abs(values - middle))) + 1e-9
        spread = max(spread, least_spread)
        one = np.clip((values - middle) / spread, -8.0, 8.0) * known
        on = _window(np.fft.irfft2(np.fft.rfft2(one, shape) * mask, shape), reach)
        inside = on / np.maximum(ones, 1.0)
        outside = (one.sum() - on) / np.maximum(total - ones, 1.0)
        score += (inside - outside) ** 2
    place = _nearest_peak(score, reach)
    return None if place is None else place * shrink


def _features(flat: FloatImage, size: tuple[int, int]) -> list[FloatImage]:
    small = shrunk(flat, size)
    found = []
    for c in range(small.shape[2]):
        one = np.ascontiguousarray(small[:, :, c])
        x, y = cv2.Sobel(one, cv2.CV_32F, 1, 0), cv2.Sobel(one, cv2.CV_32F, 0, 1)
        found += [one, cv2.GaussianBlur(np.log(x * x + y * y + 1e-8), (0, 0), 1.5)]
    return found


def _window(full: FloatArray, reach: tuple[int, int]) -> FloatArray:
    """Correlations at shifts -reach..reach in y and x."""
    x, y = (np.arange(-one, one + 1) for one in reach)
    return np.asarray(full[np.ix_(y, x)])


def _nearest_peak(score: FloatArray, reach: tuple[int, int]) -> FloatArray | None:
    top = float(score.max())
    filled = top < _PEAK * float(np.median(score))
    if top < (_SURE_SCORE if filled else _LEAST_SCORE):
        return None
    dilated = cv2.dilate(score, np.ones((3, 3)))
    y, x = np.nonzero((score >= dilated) & (score >= (1.0 if filled else _GOOD) * top))
    most_x, most_y = reach
    inner = np.flatnonzero((np.abs(y - most_y) < most_y) & (np.abs(x - most_x) < most_x))
    if not len(inner):
        return None
    y, x = y[inner], x[inner]
    k = int(np.argmin(((y - most_y) / most_y) ** 2 + ((x - most_x) / most_x) ** 2))
    place = []
    for before, at, after, most in (
        (score[y[k], x[k] - 1], x[k], score[y[k], x[k] + 1], most_x),
        (score[y[k] - 1, x[k]], y[k], score[y[k] + 1, x[k]], most_y),
    ):
        bend = before - 2 * score[y[k], x[k]] + after
        place.append(at - most + (0.5 * (before - after) / bend if bend < 0 else 0.0))
    return np.array(place)
