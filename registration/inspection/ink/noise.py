"""How strips scatter on full lines and on bare ground, learned from both in the look itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.ink.passes import REACH, Passes
from registration.inspection.ink.shares import ACROSS, StripNoise, measured, strips_of
from registration.inspection.values import FloatImage
from registration.inspection.ways import Seen, Ways

_BARE: Final = 2000
"""Strips laid across unwritten ground."""
_FEWEST_PX: Final = 200
"""Pixels where one has room."""
_BESIDE: Final = (0.9, 1.4)
"""Widths from a line's middle, between which lies what its shade and slopes change."""
_LEAST: Final = 0.02
"""Least spread of shares of full lines."""
_RESIDUE: Final = 0.08
"""Of its ink, that a bare place may seem to hold: neighbours bulge into it."""
_FEWEST: Final = 4
"""Places on full lines by which their spread is learned."""
_MOST_TIED: Final = 0.95
_SURE: Final = 3.0
"""Spreads within which neighbours tell how alike they are."""


@dataclass(frozen=True)
class Noise:
    """How measured shares and misfits scatter, at each of n places.

    Attributes
    ----------
    full, bare : (n,) float64
        Spread of a share on full and on bare lines.
    tie : float
        Correlation of neighbouring places.
    misfit_full, misfit_bare : (n, 2) float64
        Usual logarithm of a misfit, and its spread.
    shaded : (n, 2) float64
        Where shares of bare places beside ink lie, that its shade changes, and their spread.
    """

    full: FloatArray
    bare: FloatArray
    tie: float
    misfit_full: FloatArray
    misfit_bare: FloatArray
    shaded: FloatArray

    @property
    def full_is_told(self) -> BoolArray:
        """Whether full places stand apart from bare ones beside ink, (n,)."""
        spread = np.hypot(self.full, self.shaded[:, 1])
        return np.asarray(1.0 - self.shaded[:, 0] > _SURE * spread)


@dataclass(frozen=True)
class BareStrips:
    """Strips across unwritten ground or older ink.

    Attributes
    ----------
    strips : (k, u c) float64
    like : (k,) int64
        Place along a line whose direction each has.
    """

    strips: FloatArray
    like: IntArray

    @staticmethod
    def laid(
        rest: FloatImage,
        passes: Passes,
        kind: IntArray,
        lost: BoolArray,
        seen: Seen,
        ways: Ways,
        rows: IntArray,
        over: FloatImage | None,
        beside: bool = False,
    ) -> BareStrips:
        """Lay them where no fresh line is near, on older ink where ``over`` tells of it."""
        nothing = BareStrips(np.zeros((0, len(ACROSS) * rest.shape[2])), np.zeros(0, np.int64))
        clear = (passes.near[:, :, 0] > REACH) & ~lost
        clear &= (passes.near[:, :, 1] > REACH) if over is None else (over > 0.5)
        if beside:
            away = passes.near[:, :, 0]
            clear = (away > _BESIDE[0]) & (away < _BESIDE[1]) & ~lost
        framed = cv2.copyMakeBorder(
            clear.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0
        )
        room = cv2.distanceTransform(framed, cv2.DIST_L2, 5)[1:-1, 1:-1]
        half = float(np.median(np.linalg.norm(seen.across, axis=1) * ways.width))
        y, x = np.nonzero(clear if beside else room > (half if over is None else 0.5 * half))
        if len(y) < _FEWEST_PX or not len(rows):
            return nothing
        rng = np.random.default_rng(26)
        pick, like = rng.integers(0, len(y), _BARE), rows[rng.integers(0, len(rows), _BARE)]
        at = np.column_stack([x[pick], y[pick]]).astype(np.float64)
        laid = Seen(at, seen.across[like], seen.along[like])
        return BareStrips(strips_of(rest, laid, ways.only(like)).reshape(_BARE, -1), like)


def noise_of(
    share: FloatArray,
    u_share: float,
    misfit: FloatArray,
    good: BoolArray,
    run: IntArray,
    bare: BareStrips,
    own: FloatArray,
    strip_noise: StripNoise,
) -> tuple[FloatArray, float, FloatArray]:
    """Return spreads of full and bare shares, the tie, and misfits (2, 2) of full and bare.

    Parameters
    ----------
    share : (n,) float64
    u_share : float
        Usual uncertainty of one: its spread where too few lines are full.
    misfit : (n,) float64
    good : (n,) bool
        Places that are seen and full.
    run : (n,) int64
    bare : BareStrips
    own : (n, u, c) float64
        What full ink adds.
    strip_noise : StripNoise
    """
    off = share[good] - 1.0
    spread, window = u_share, 0.5
    for _ in range(3):
        near = off[np.abs(off) < window]
        spread = _spread(near) if len(near) > _FEWEST else u_share
        window = max(0.5, _SURE * spread)
    pair = np.flatnonzero(good[1:] & good[:-1] & (run[1:] == run[:-1]))
    a, b = share[pair] - 1.0, share[pair + 1] - 1.0
    use = (np.abs(a) < _SURE * spread) & (np.abs(b) < _SURE * spread)
    tie = float((a * b)[use].sum() / max(float((a * a)[use].sum()), 1e-9)) if use.any() else 0.5
    full = _level(misfit[good])
    on_bare, without = spread, full
    if len(bare.strips):
        shape = (len(bare.strips), *own.shape[1:])
        seen = measured(bare.strips.reshape(shape), own[bare.like], strip_noise)
        on_bare, without = _spread(seen.share), _level(np.log(np.maximum(seen.misfit, 1e-9)))
    spreads = np.array([max(spread, _LEAST), max(float(np.hypot(on_bare, _RESIDUE)), spread)])
    return spreads, min(max(tie, 0.0), _MOST_TIED), np.array([full, without])


def _spread(values: FloatArray) -> float:
    """Standard deviation, by the median of what deviates."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values)))) if len(values) else 1.0


def _level(values: FloatArray) -> tuple[float, float]:
    if not len(values):
        return 0.0, 1.0
    return float(np.median(values)), max(_spread(values), 0.1)
