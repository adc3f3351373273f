"""Find pixels that are neither ink nor bath: glare, shadows, bubbles, debris."""

from __future__ import annotations

import cv2
import numpy as np

from kernels import jit
from kernels.arrays import BoolArray, FloatArray
from registration.inspection.ink.ink_image import BathNoise
from registration.inspection.pictures.working import Mask
from registration.inspection.values import FloatImage

_SURE = 6.0
"""Standard deviations from both, at least."""
_HOLE = 8.0
"""Widths: a larger hole in a strange ring (a dish's rim) isn't strange itself."""
_MOST_INK = 2.5
"""Of ink's usual difference from bath: thick ink."""
_OF_EDGE = np.linspace(0.0, 1.0, 5)
"""Shares of ink in the light of a blurred edge."""
_UNLIKE = 2.0
"""Times what one place of bath in fifty exceeds: that isn't bath."""


def strangeness(
    smooth: FloatImage,
    bath: BathNoise,
    ink: FloatArray,
    is_log: bool,
    among_inks: FloatArray | None = None,
    rim: FloatArray | None = None,
) -> FloatImage:
    """Deviations of the smoothed channels (h, w, c) from bath, ink and all between, (h, w).

    Thin ink lies straight between ink and bath in logarithms, a blurred edge in light: either isn't
    strange.

    Parameters
    ----------
    smooth : (h, w, c) float32
    bath : BathNoise
    ink : (c,) float64
        Mean of ink less that of bath.
    is_log : bool
        Whether channels are logarithms.
    among_inks : (c, c) float64 or None
        Covariance of the ink of strokes that differ.
    rim : (c,) float64 or None
        What ink's edges show over the bath, where that isn't between bath and ink.
    """
    count = smooth.shape[2]
    covariance = bath.covariance + 1e-4 * np.diag(ink**2) + 1e-12 * np.eye(count)
    covariance = covariance if among_inks is None else covariance + among_inks
    root = np.linalg.cholesky(np.linalg.inv(covariance)).astype(np.float32)
    begin = np.zeros(count) if rim is None else rim
    whitened = (smooth - bath.mean.astype(np.float32)) @ root
    stretches = [np.array([_MOST_INK * begin @ root, _MOST_INK * ink @ root])]
    if is_log:
        edge = np.log1p(np.outer(_OF_EDGE, np.expm1(ink))) @ root
        stretches += [edge[k : k + 2] for k in range(len(edge) - 1)]
    return _off_lines(whitened, np.array(stretches, dtype=np.float32))


@jit
def _off_lines(values: FloatImage, stretches: FloatImage) -> FloatImage:
    """Distance of values (h, w, c) from the nearest of stretches of lines (n, 2, c), (h, w).

    NaN where a value is.
    """
    high, wide, count = values.shape
    out = np.empty((high, wide), np.float32)
    way = stretches[:, 1] - stretches[:, 0]
    power = np.empty(len(way), np.float32)
    for n in range(len(way)):
        power[n] = max((way[n] * way[n]).sum(), np.float32(1e-12))
    zero, one = np.float32(0.0), np.float32(1.0)
    for row in range(high):
        for column in range(wide):
            least = np.float32(np.inf)
            for n in range(len(way)):
                dot = zero
                for c in range(count):
                    dot += (values[row, column, c] - stretches[n, 0, c]) * way[n, c]
                share = min(max(dot / power[n], zero), one)
                square = zero
                for c in range(count):
                    off = values[row, column, c] - stretches[n, 0, c] - share * way[n, c]
                    square += off * off
                if square < least or np.isnan(square):
                    least = square
            out[row, column] = np.sqrt(least)
    return out


def strange_places(away: FloatImage, free: Mask, fresh: Mask, width_px: float) -> BoolArray:
    """Where a picture's `strangeness` (h, w) fits neither bath nor ink, (h, w).

    Parameters
    ----------
    away : (h, w) float32
    free, fresh : (h, w) uint8
    width_px : float
    """
    # Quantiles that a needle over a tenth of the picture doesn't reach.
    limit = max(_SURE, 3.0 * _quantile(away, free, 80), 2.0 * _quantile(away, fresh, 70))
    return _grown((away > limit).astype(np.uint8), width_px)


def unlike_bath(away: FloatImage, free: Mask) -> FloatImage:
    """`strangeness` over the most that bath shows, (h, w): above 1 it surely isn't bath."""
    most = max(_UNLIKE * _quantile(away, free, 98), 1.0)
    return np.asarray(away / most, dtype=np.float32)


def _quantile(values: FloatImage, mask: Mask, percent: float) -> float:
    some = values[mask > 0]
    return float(np.percentile(some[:: max(1, len(some) // 50_000)], percent)) if len(some) else 0.0


def grown(mask: BoolArray, width_px: float) -> BoolArray:
    """A mask without specks, its rings filled, and a little wider (light spills over)."""
    return _grown(mask.astype(np.uint8), width_px)


def _grown(mask: Mask, width_px: float) -> BoolArray:
    if not mask.any():
        return mask > 0
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * round(0.3 * width_px) + 3,) * 2)
    closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, disc)
    outlines, tree = cv2.findContours(closed, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    out = np.zeros_like(mask)
    least = max(3.0, (0.3 * width_px) ** 2)
    for outline, links in zip(outlines, tree[0], strict=True):
        box = cv2.boundingRect(outline)
        if links[3] < 0 and box[2] * box[3] >= least:
            cv2.drawContours(out, [outline], -1, 1, cv2.FILLED)
    for outline, links in zip(outlines, tree[0], strict=True):
        if links[3] >= 0 and cv2.contourArea(outline) > (_HOLE * width_px) ** 2:
            cv2.drawContours(out, [outline], -1, 0, cv2.FILLED)
    return np.asarray(cv2.dilate(out, disc) > 0)
