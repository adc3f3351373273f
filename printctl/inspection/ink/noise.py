"""Learn the scatter of strips on full lines and on bare ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.inspection.ink.passes import REACH_WIDTHS
from printctl.inspection.ink.shares import (
    ACROSS_WIDTHS,
    StripNoise,
    measure_shares,
    sample_strips,
)
from printctl.inspection.ink.view_fit import ShiftedLines
from printctl.inspection.path_samples import ProjectedSamples
from printctl.inspection.values import FloatImage

_BARE_STRIPS: Final = 2000
"""Number of strips sampled across unwritten ground."""
_MIN_BARE_PX: Final = 200
"""Least number of pixels where such a strip fits."""
_BESIDE_WIDTHS: Final = (0.9, 1.4)
"""Distances in widths from a line's middle between which its shade and slopes are measured."""
MIN_FULL_SPREAD: Final = 0.02
"""Least spread of full lines' shares."""
_BARE_RESIDUE_SHARE: Final = 0.08
"""Share of ink that a bare place may read: neighbours bulge into it."""
MIN_FULL_PLACES: Final = 4
"""Least number of places on full lines for learning their share and its spread."""
_MAX_CORRELATION: Final = 0.95
"""Largest correlation of neighbouring places."""
_NEIGHBOUR_SPREADS: Final = 3.0
"""Spreads within which shares count as those of full places."""


@dataclass(frozen=True)
class Scatter:
    """Scatter of shares and misfits in one class of places.

    Attributes
    ----------
    full, bare : float
        Spread of a share on full and on bare lines.
    misfit_full, misfit_bare : (float, float)
        Usual logarithm of a misfit, and its spread.
    shaded : (float, float)
        Mean share that bare places beside ink read because of its shade, and its spread.
    correlation : float
        Correlation of neighbouring places.
    """

    full: float
    bare: float
    misfit_full: tuple[float, float]
    misfit_bare: tuple[float, float]
    shaded: tuple[float, float]
    correlation: float


@dataclass(frozen=True)
class Noise:
    """Scatter at each of n places, (n,) or (n, 2) float64."""

    full: FloatArray
    bare: FloatArray
    misfit_full: FloatArray
    misfit_bare: FloatArray
    shaded: FloatArray
    correlation: FloatArray

    @staticmethod
    def blank(count: int) -> Noise:
        """Return an empty table for ``count`` places, filled by `put`."""
        one, two = np.ones(count), np.ones((count, 2))
        return Noise(one, one.copy(), two, two.copy(), two.copy(), np.full(count, 0.5))

    def put(self, rows: BoolArray, scatter: Scatter, dim: FloatArray | float = 1.0) -> None:
        """Copy the scatter of a class, widened by ``dim``, into some rows."""
        self.full[rows], self.bare[rows] = scatter.full * dim, scatter.bare * dim
        self.misfit_full[rows], self.misfit_bare[rows] = scatter.misfit_full, scatter.misfit_bare
        self.correlation[rows] = scatter.correlation
        self.shaded[rows, 0], self.shaded[rows, 1] = scatter.shaded[0], scatter.shaded[1] * dim

    @property
    def full_is_distinct(self) -> BoolArray:
        """Places where full ink is distinct from bare ground beside ink, (n,)."""
        spread = np.hypot(self.full, self.shaded[:, 1])
        return np.asarray(1.0 - self.shaded[:, 0] > _NEIGHBOUR_SPREADS * spread)


@dataclass(frozen=True)
class BareStrips:
    """Strips sampled across unwritten ground or older ink.

    Attributes
    ----------
    strips : (k, u, c) float64
    like : (k,) int64
        Place along a line whose direction and width each takes.
    """

    strips: FloatArray
    like: IntArray

    @staticmethod
    def sample(
        rest: FloatImage,
        shifted: ShiftedLines,
        lost: BoolArray,
        like: BoolArray,
        beside: bool = False,
    ) -> BareStrips:
        """Sample strips at random where no fresh line is near.

        Parameters
        ----------
        rest : (h, w, c) float32
            The view less the rendered lines.
        shifted : ShiftedLines
        lost : (h, w) bool
        like : (n,) bool
            Places whose directions and widths they have.
        beside : bool
            Whether to sample just beside fresh lines instead.
        """
        samples, projected, rows = shifted.samples, shifted.projected, np.flatnonzero(like)
        fresh, older = np.moveaxis(shifted.passes.near, 2, 0)
        if beside:
            clear = ~lost & (fresh > _BESIDE_WIDTHS[0]) & (fresh < _BESIDE_WIDTHS[1])
        else:
            clear = ~lost & (fresh > REACH_WIDTHS) & (older > REACH_WIDTHS)
            framed = cv2.copyMakeBorder(
                clear.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0
            )
            clearance_px = cv2.distanceTransform(framed, cv2.DIST_L2, 5)[1:-1, 1:-1]
            half = float(np.median(np.linalg.norm(projected.across, axis=1) * samples.width))
            clear = clearance_px > half
        y, x = np.nonzero(clear)
        if len(y) < _MIN_BARE_PX or not len(rows):
            return BareStrips(
                np.zeros((0, len(ACROSS_WIDTHS), rest.shape[2])), np.zeros(0, np.int64)
            )
        rng = np.random.default_rng(26)
        pick = rng.integers(0, len(y), _BARE_STRIPS)
        own = rows[rng.integers(0, len(rows), _BARE_STRIPS)]
        at = np.column_stack([x[pick], y[pick]]).astype(np.float64)
        sites = ProjectedSamples(at, projected.across[own], projected.along[own])
        return BareStrips(sample_strips(rest, sites, samples.only(own)), own)


def learn_scatter(
    share: FloatArray,
    u_share: float,
    misfit: FloatArray,
    good: BoolArray,
    run: IntArray,
    bare: BareStrips,
    own: FloatArray,
    strip_noise: StripNoise,
) -> Scatter:
    """Learn the scatter of a class of places.

    Parameters
    ----------
    share : (n,) float64
    u_share : float
        Usual uncertainty of one: its spread where too few lines are full.
    misfit : (n,) float64
    good : (n,) bool
        Places of the class that are seen and full.
    run : (n,) int64
    bare : BareStrips
    own : (n, u, c) float64
        Full ink's profile.
    strip_noise : StripNoise
    """
    off = share[good] - 1.0
    spread, window = u_share, 0.5
    for _ in range(3):
        near = off[np.abs(off) < window]
        spread = robust_spread(near) if len(near) > MIN_FULL_PLACES else u_share
        window = max(0.5, _NEIGHBOUR_SPREADS * spread)
    on_bare, full = spread, median_and_spread(misfit[good])
    without = full
    if len(bare.strips):
        seen = measure_shares(bare.strips, own[bare.like], strip_noise)
        on_bare = robust_spread(seen.share)
        without = median_and_spread(np.log(np.maximum(seen.misfit, 1e-9)))
    of_bare = max(float(np.hypot(on_bare, _BARE_RESIDUE_SHARE)), spread)
    correlation = neighbour_correlation(share, spread, good, run)
    return Scatter(
        max(spread, MIN_FULL_SPREAD), of_bare, full, without, (0.0, of_bare), correlation
    )


def neighbour_correlation(
    share: FloatArray, spread: float, good: BoolArray, run: IntArray
) -> float:
    """Return the correlation of neighbouring full places' shares."""
    pair = np.flatnonzero(good[1:] & good[:-1] & (run[1:] == run[:-1]))
    a, b = share[pair] - 1.0, share[pair + 1] - 1.0
    use = (np.abs(a) < _NEIGHBOUR_SPREADS * spread) & (np.abs(b) < _NEIGHBOUR_SPREADS * spread)
    correlation = (
        float((a * b)[use].sum() / max(float((a * a)[use].sum()), 1e-9)) if use.any() else 0.5
    )
    return min(max(correlation, 0.0), _MAX_CORRELATION)


def robust_spread(values: FloatArray) -> float:
    """Return the standard deviation by the median absolute deviation; 1 for no values."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values)))) if len(values) else 1.0


def median_and_spread(values: FloatArray) -> tuple[float, float]:
    """Return median and spread of log misfits; 0 and 1 for none."""
    if not len(values):
        return 0.0, 1.0
    return float(np.median(values)), max(robust_spread(values), 0.1)
