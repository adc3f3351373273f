"""Measure the share of ink at each place along the lines, by generalised least squares.

Across each line the view is sampled into a strip. Less what the model draws of everything else, a
strip is the line's own profile times its share of ink, moved and widened a little, plus noise whose
covariance across the strip is learned from the rest of all strips of the look.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.ink.ink_model import InkModel
from registration.inspection.values import FloatImage
from registration.inspection.ways import Seen, Ways

ACROSS: Final = np.linspace(-1.0, 1.0, 17)
"""Widths from the middle at which a strip is sampled."""
_OFF: Final = 0.08
"""Standard deviation of a line's own place beside the layer's, widths."""
_WIDER: Final = 0.08
"""And of its width."""
_FEWEST: Final = 40
"""Strips by which noise is learned."""
_INDEPENDENT: Final = 0.3
"""Of strips: their neighbours tell the same."""
_ROUGH: Final = 0.15
"""Of a profile, to which the model is right at any sample."""
_LEAST: Final = 1e-4
"""Least variance of a sample; that of the ground is 1."""
_FLOOR: Final = 0.02
"""Of the mean variance, that every sample has at least."""


@dataclass(frozen=True)
class StripNoise:
    """Inverse covariance of a strip's samples, (u c, u c)."""

    inverse: FloatArray

    @staticmethod
    def of(full: FloatArray, bare: FloatArray, own: FloatArray, doubt: FloatArray) -> StripNoise:
        """Learn it from rests (n, u c) on full lines and on the ground: the mean of both.

        That is Fisher's linear discriminant. No model is better than to a part of what ink adds,
        ``own`` (n, u, c): neighbours of a gap bulge into it; nor than its ``doubt`` (u, u): of
        lines that touch only what their copies add up to is told.
        """
        size = full.shape[1]
        wide = np.kron(doubt, np.eye(size // len(doubt)))
        rough = _ROUGH**2 * float((own**2).mean()) if own.size else 0.0
        both = [covariance(one) for one in (full, bare) if len(one) >= _FEWEST]
        if not both:
            return StripNoise(np.eye(size))
        return StripNoise(np.linalg.inv(np.mean(both, axis=0) + rough * np.eye(size) + 0.5 * wide))


def covariance(rests: FloatArray) -> FloatArray:
    """Covariance about 0, shrunk to a multiple of one, outlying strips counting less.

    By the oracle approximating shrinkage of Chen et al. (2010, IEEE TSP 58, 5016); neighbouring
    strips tell the same in part.
    """
    size, count = rests.shape[1], _INDEPENDENT * len(rests)
    weight = np.ones(len(rests))
    cov = np.eye(size)
    for _ in range(2):
        cov = (rests * weight[:, None]).T @ rests / weight.sum()
        trace, square = float(np.trace(cov)), float((cov**2).sum())
        top = (1.0 - 2.0 / size) * square + trace**2
        low = (count + 1.0 - 2.0 / size) * (square - trace**2 / size)
        shrink = max(min(1.0, top / low) if low > 0 else 1.0, _FLOOR)
        cov = (1.0 - shrink) * cov + (shrink * trace / size + _LEAST) * np.eye(size)
        far = (rests @ np.linalg.inv(cov) * rests).sum(axis=1) / size
        weight = 1.0 / (1.0 + np.maximum(far / max(float(np.median(far)), 1e-9) - 1.0, 0.0) ** 2)
    return cov


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
    """

    share: FloatArray
    u_share: FloatArray
    offset: FloatArray
    wider: FloatArray
    misfit: FloatArray

    @staticmethod
    def blank(count: int) -> Shares:
        """Return shares of so many places, to be put in."""
        return Shares(*np.zeros((5, count)))

    def put(self, rows: BoolArray | IntArray, part: Shares) -> None:
        """Take over those of some places."""
        for name, values in vars(part).items():
            getattr(self, name)[rows] = values

    def over(self, level: float) -> Shares:
        """Return shares of a level."""
        return replace(self, share=self.share / level, u_share=self.u_share / level)


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
    ground, part = model.at(0, ACROSS, normal), over[:, :, None]
    if not over.any():
        return ground
    return np.asarray(ground * (1.0 - part) + model.at(1, ACROSS, normal) * part)


def measured(
    strips: FloatArray, own: FloatArray, noise: StripNoise, lost: BoolArray | None = None
) -> Shares:
    """Fit share, offset and widening to strips (n, u, c) that hold the line's own ink alone.

    Samples that are ``lost`` (n, u) aren't used: the fewer are left, the larger is the uncertainty.
    """
    n, samples, channels = strips.shape
    if lost is None or not lost.any():
        return _measured(strips, own, noise.inverse, samples * channels)
    found = Shares.blank(n)
    for rows, inverse, number in by_seen_samples(noise.inverse, lost):
        found.put(rows, _measured(strips[rows], own[rows], inverse, max(number, 1)))
    return found


def by_seen_samples(
    inverse: FloatArray, lost: BoolArray
) -> Iterator[tuple[IntArray, FloatArray, int]]:
    """Group strips by their samples that are ``lost`` (n, u).

    Yield the rows of each group, the inverse covariance of what is left (0 for the others), and the
    number of samples left in all channels.
    """
    channels = len(inverse) // lost.shape[1]
    covariance = np.linalg.inv(inverse)
    number = lost @ (1 << np.arange(lost.shape[1]))  # of each pattern, in bits
    order = np.argsort(number, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(number[order])) + 1):
        left = np.flatnonzero(np.repeat(~lost[rows[0]], channels))
        part = np.zeros_like(covariance)
        part[np.ix_(left, left)] = np.linalg.inv(covariance[np.ix_(left, left)])
        yield rows, part, len(left)


def beside_line(rests: FloatArray, own: FloatArray) -> FloatArray:
    """Return what of rests (n, u c) no share, place or width of the line itself explains.

    A thin stretch of a layer is no noise of its others.
    """
    basis = _basis(own)[:, ::2]
    power = np.einsum("nij,nkj->nik", basis, basis)
    power += 1e-9 * (1.0 + power.max(initial=0.0)) * np.eye(2)
    found = np.linalg.solve(power, np.einsum("nij,nj->ni", basis, rests)[:, :, None])
    return np.asarray(rests - np.einsum("ni,nij->nj", found[:, :, 0], basis))


def _basis(own: FloatArray) -> FloatArray:
    """Return what share, offset and widening change in strips, (n, 3, u c)."""
    slope = np.gradient(own, ACROSS[1] - ACROSS[0], axis=1)
    terms = np.stack([own, -slope, -slope * ACROSS[None, :, None]], axis=1)
    return np.asarray(terms.reshape(len(own), 3, own.shape[1] * own.shape[2]))


def _measured(strips: FloatArray, own: FloatArray, inverse: FloatArray, samples: int) -> Shares:
    """Fit strips by one inverse covariance, in which so many samples count."""
    n = len(strips)
    basis = _basis(own)
    flat = strips.reshape(n, -1)
    weighted = basis @ inverse
    power = weighted @ basis.transpose(0, 2, 1)
    score = np.einsum("nij,nj->ni", weighted, flat)
    # What moves and widens ink does so by its share; the designed line is the prior.
    power[:, 1, 1] += _OFF**-2
    power[:, 2, 2] += _WIDER**-2
    power[:, 0, 0] += 1e-9
    cov = np.linalg.inv(power)
    found = np.einsum("nij,nj->ni", cov, score)
    left = flat - np.einsum("ni,nij->nj", found, basis)
    misfit = (left @ inverse * left).sum(axis=1) / samples
    return Shares(found[:, 0], np.sqrt(cov[:, 0, 0]), found[:, 1], found[:, 2], misfit)
