"""How much of its ink lies at each place along the lines, by generalised least squares.

Across each line the view is sampled into a strip. Less what the model draws of everything else, a
strip is the line's own profile times its share of ink, moved and widened a little, plus noise whose
covariance across the strip is learned from the rest of all strips of the look.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import FloatArray, IntArray
from registration.inspection.ink_model import InkModel
from registration.inspection.values import FloatImage
from registration.inspection.ways import Seen, Ways

ACROSS: Final = np.linspace(-1.0, 1.0, 17)
"""Widths from the middle at which a strip is sampled."""
_OFF: Final = 0.08
"""Standard deviation of a line's own place beside the layer's, widths."""
_WIDER: Final = 0.08
"""And of its width."""
_SCALES: Final = (1.0, 0.84, 0.7, 0.57, 0.46, 0.37, 1.2)
"""Widths over the usual one around which strips are fitted: flow that is short or ample, too."""
NARROWEST: Final = 0.3
WIDEST: Final = 1.4
"""Widths over the usual one within which a line is drawn: those fitted, and a little more."""
_UNUSUAL: Final = 5.0
"""Natural logarithm of odds against each of those: a print holds some thin stretches in metres."""
_NEIGHBOUR: Final = (0.5, 0.5, 0.2, 0.2)
"""Standard deviations of a neighbour's share on either side, and of where its edge lies, widths."""
_FEWEST: Final = 40
"""Strips by which noise is learned."""
_INDEPENDENT: Final = 0.3
"""Of strips: their neighbours tell the same."""
_ROUGH: Final = 0.15
"""Of a profile, to which the model is right at any sample."""
_CONCENTRATE: Final = 4
"""Steps of concentration: their results hardly change from the third on."""
_LEAST: Final = 1e-4
"""Least variance of a sample; that of the ground is 1."""
_FLOOR: Final = 0.02
"""Of the mean variance, that every sample has at least."""


@dataclass(frozen=True)
class StripNoise:
    """Inverse covariance of a strip's samples, (u c, u c)."""

    inverse: FloatArray

    @staticmethod
    def of(full: FloatArray, bare: FloatArray, own: FloatArray) -> StripNoise:
        """Learn it from rests (n, u c) on full lines and on the ground: the mean of both.

        That is Fisher's linear discriminant. No model is better than to a part of what ink adds,
        ``own`` (n, u, c): neighbours of a gap bulge into it.
        """
        size = full.shape[1]
        rough = _ROUGH**2 * float((own**2).mean()) if own.size else 0.0
        both: list[FloatArray] = []
        for one in (bare, full):
            if len(one) >= _FEWEST:
                both.append(_covariance(one, both[0] if both else np.eye(size)))
        if not both:
            return StripNoise(np.eye(size))
        return StripNoise(np.linalg.inv(np.mean(both, axis=0) + (_LEAST + rough) * np.eye(size)))


def _covariance(rests: FloatArray, start: FloatArray) -> FloatArray:
    """Covariance about 0 of the bulk of strips.

    By concentration from a ``start``: the half that lies nearest tells the shape, the median
    distance the size (Rousseeuw and Van Driessen 1999, Technometrics 41, 212), so that thin
    stretches of up to half a layer aren't taken for noise. Then outlying strips count less.
    """
    cov = start
    for _ in range(_CONCENTRATE):
        far = _distances(rests, cov)
        inner = (far <= np.median(far)).astype(np.float64)
        cov = _shrunk(rests, inner)
        cov *= float(np.median(_distances(rests, cov)))
    far = _distances(rests, cov)
    weight = 1.0 / (1.0 + np.maximum(far / max(float(np.median(far)), 1e-9) - 1.0, 0.0) ** 2)
    return _shrunk(rests, weight)


def _distances(rests: FloatArray, cov: FloatArray) -> FloatArray:
    """Mean square of each strip over noise, (n,)."""
    own = np.einsum("ni,ij,nj->n", rests, np.linalg.inv(cov), rests)
    return np.asarray(own / rests.shape[1])


def _shrunk(rests: FloatArray, weight: FloatArray) -> FloatArray:
    """Weighted covariance about 0, shrunk to a multiple of one.

    By the oracle approximating shrinkage of Chen et al. (2010, IEEE TSP 58, 5016); neighbouring
    strips tell the same in part.
    """
    size, count = rests.shape[1], _INDEPENDENT * float(weight.sum())
    cov = (rests * weight[:, None]).T @ rests / weight.sum()
    trace, square = float(np.trace(cov)), float((cov**2).sum())
    top = (1.0 - 2.0 / size) * square + trace**2
    low = (count + 1.0 - 2.0 / size) * (square - trace**2 / size)
    shrink = max(min(1.0, top / low) if low > 0 else 1.0, _FLOOR)
    return np.asarray((1.0 - shrink) * cov + shrink * trace / size * np.eye(size))


@dataclass(frozen=True)
class Shares:
    """What strips tell.

    Attributes
    ----------
    share, u_share : (n,) float64
        Of its ink, and the standard uncertainty that the strip's noise gives it.
    offset, wider : (n,) float64, widths
        How far a line lies to the left of its place, and how much wider it is.
    misfit : (n,) float64
        Mean square of what is left, over noise.
    level : (n,) float64
        How much of usual ink lies in the line's middle, however wide it is.
    loss : (n,) float64
        Minus twice the logarithm of the posterior density.
    """

    share: FloatArray
    u_share: FloatArray
    offset: FloatArray
    wider: FloatArray
    misfit: FloatArray
    level: FloatArray
    loss: FloatArray


def strips_of(image: FloatImage, seen: Seen, ways: Ways) -> FloatArray:
    """Return samples across each place, (n, u, c)."""
    across = ways.width[:, None] * ACROSS
    each = [
        seen.profiles(np.ascontiguousarray(image[:, :, c]), across) for c in range(image.shape[2])
    ]
    return np.stack(each, axis=2).astype(np.float64)


def own_profile(model: InkModel, over: FloatArray, seen: Seen) -> FloatArray:
    """Return what full ink adds to each strip, (n, u, c); ``over`` (n, u) is older ink below."""
    normal = seen.across / np.maximum(np.linalg.norm(seen.across, axis=1, keepdims=True), 1e-9)
    zero = np.zeros(len(normal), dtype=np.int64)
    ground = model.at(zero, ACROSS, normal)
    if not over.any():
        return ground
    older = model.at(zero + 1, ACROSS, normal)
    part = over[:, :, None]
    return np.asarray(ground * (1.0 - part) + older * part)


def sampled(own: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return profiles (m, u, c) at other distances (m, u), and their slopes there."""
    step = ACROSS[1] - ACROSS[0]
    place = np.clip((at - ACROSS[0]) / step, 0.0, len(ACROSS) - 1 - 1e-9)
    low = place.astype(np.int64)
    part = (place - low)[:, :, None]
    row = np.arange(len(own))[:, None]
    slope = np.gradient(own, step, axis=1)
    values, slopes = (one[row, low] * (1 - part) + one[row, low + 1] * part for one in (own, slope))
    return values, slopes


def measured(
    strips: FloatArray,
    own: FloatArray,
    near: FloatArray | None,
    noise: StripNoise,
    run: IntArray,
    reach: int,
) -> Shares:
    """Fit share, offset and width to strips (n, u, c) that hold the line's own ink alone.

    Around each of some widths the fit is linear. That of the highest posterior is taken, over
    ``reach`` places to either side: a line's width doesn't jump. What neighbours add, ``near``
    (n, u, c), is as uncertain as the line itself on either side.
    """
    fits = [_around(scale, strips, own, near, noise) for scale in _SCALES]
    independent = max(1.0, _INDEPENDENT * (2 * reach + 1))
    losses = [
        independent * mean_along(one.loss - fits[0].loss, np.ones(len(run)), run, reach)
        + 2.0 * _UNUSUAL * (k > 0)
        for k, one in enumerate(fits)
    ]
    best, row = np.argmin(losses, axis=0), np.arange(len(run))
    return Shares(
        *(np.stack([getattr(one, name) for one in fits])[best, row] for name in vars(fits[0]))
    )


def mean_along(
    values: FloatArray, weight: FloatArray, run: IntArray, reach: int, prior: float = 0.0
) -> FloatArray:
    """Return weighted means over ``reach`` places to either side, with a ``prior`` weight of 0."""
    total, norm = np.zeros(len(run)), np.full(len(run), max(prior, 1e-12))
    for k in range(-reach, reach + 1):
        near = np.clip(np.arange(len(run)) + k, 0, len(run) - 1)
        own = weight[near] * (run[near] == run)
        total, norm = total + own * values[near], norm + own
    return np.asarray(total / norm)


def _around(
    scale: float,
    strips: FloatArray,
    own: FloatArray,
    near: FloatArray | None,
    noise: StripNoise,
) -> Shares:
    """Fit strips by lines of about so much of the usual width."""
    n = len(strips)
    at = np.broadcast_to(ACROSS / scale, (n, len(ACROSS)))
    shape, slope = sampled(own, at)
    terms = [shape, -slope / scale, -slope * at[:, :, None]]
    if near is not None:
        sides = [near * side[None, :, None] for side in (ACROSS < 0.0, ACROSS > 0.0)]
        terms += sides + [np.gradient(one, ACROSS[1] - ACROSS[0], axis=1) for one in sides]
    basis = np.stack(terms, axis=1).reshape(n, len(terms), -1)
    flat = strips.reshape(n, -1)
    weighted = basis @ noise.inverse
    power = np.einsum("nij,nkj->nik", weighted, basis)
    score = np.einsum("nij,nj->ni", weighted, flat)
    # What moves and widens ink does so by its share; the line about so wide is the prior.
    power[:, 1, 1] += _OFF**-2
    power[:, 2, 2] += _WIDER**-2
    power[:, 0, 0] += 1e-9
    for k, spread in enumerate(_NEIGHBOUR[: len(terms) - 3], 3):
        power[:, k, k] += spread**-2
    cov = np.linalg.inv(power)
    found = np.einsum("nij,nj->ni", cov, score)
    left = flat - np.einsum("ni,nij->nj", found, basis)
    misfit = np.einsum("nj,jk,nk->n", left, noise.inverse, left)
    loss = misfit + (found[:, 1] / _OFF) ** 2 + (found[:, 2] / _WIDER) ** 2
    for k, spread in enumerate(_NEIGHBOUR[: len(terms) - 3], 3):
        loss = loss + (found[:, k] / spread) ** 2
    ink = min(scale, 1.0)
    return Shares(
        ink * found[:, 0], ink * np.sqrt(cov[:, 0, 0]), found[:, 1],
        scale * (1.0 + found[:, 2]) - 1.0, misfit / left.shape[1], found[:, 0], loss,
    )  # fmt: skip
