"""Measure the share of ink along lines by generalised least squares.

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
from printctl.inspection.ink.ink_model import InkModel
from printctl.inspection.path_samples import PathSamples, ProjectedSamples
from printctl.inspection.values import FloatImage

ACROSS_WIDTHS: Final = np.linspace(-1.0, 1.0, 17)
"""Distances from a line's middle at which its strip is sampled, in widths."""
_OFFSET_SD_WIDTHS: Final = 0.08
"""Prior standard deviation of a line's offset from the layer's shift, in widths."""
_WIDENING_SD: Final = 0.08
"""Prior standard deviation of a line's relative widening."""
_MIN_STRIPS: Final = 40
"""Least number of strips for learning their noise."""
_INDEPENDENT_SHARE: Final = 0.3
"""Share of strips that count as independent of their neighbours."""
_MODEL_ERROR_SHARE: Final = 0.15
"""Relative error of the model's profile at any sample."""
_MIN_VARIANCE: Final = 1e-4
"""Least variance of a sample, where the ground's is 1."""
_MIN_SHRINKAGE: Final = 0.02
"""Least shrinkage of a covariance towards its mean variance."""


@dataclass(frozen=True)
class StripNoise:
    """Inverse covariance of a strip's samples, (u c, u c)."""

    inverse: FloatArray

    @staticmethod
    def of(
        full: FloatArray, bare: FloatArray, own: FloatArray, model_covariance: FloatArray
    ) -> StripNoise:
        """Estimate from rests (n, u c) on full lines and on the ground, as the mean of both.

        That is Fisher's linear discriminant. Added are a relative error of the profile
        ``own`` (n, u, c), since neighbours of a gap bulge into it, and the profile's
        ``model_covariance`` (u, u), since lines that touch determine only their copies' sum.
        """
        size = full.shape[1]
        wide = np.kron(model_covariance, np.eye(size // len(model_covariance)))
        rough = _MODEL_ERROR_SHARE**2 * float((own**2).mean()) if own.size else 0.0
        both = [covariance(one) for one in (full, bare) if len(one) >= _MIN_STRIPS]
        if not both:
            return StripNoise(np.eye(size))
        return StripNoise(np.linalg.inv(np.mean(both, axis=0) + rough * np.eye(size) + 0.5 * wide))


def covariance(rests: FloatArray) -> FloatArray:
    """Return the covariance about 0, shrunk towards its mean variance, outliers down-weighted.

    By the oracle approximating shrinkage of Chen et al. (2010, IEEE TSP 58, 5016); neighbouring
    strips are correlated.
    """
    size, count = rests.shape[1], _INDEPENDENT_SHARE * len(rests)
    weight = np.ones(len(rests))
    cov = np.eye(size)
    for _ in range(2):
        cov = (rests * weight[:, None]).T @ rests / weight.sum()
        trace, square = float(np.trace(cov)), float((cov**2).sum())
        top = (1.0 - 2.0 / size) * square + trace**2
        low = (count + 1.0 - 2.0 / size) * (square - trace**2 / size)
        shrink = max(min(1.0, top / low) if low > 0 else 1.0, _MIN_SHRINKAGE)
        cov = (1.0 - shrink) * cov + (shrink * trace / size + _MIN_VARIANCE) * np.eye(size)
        far = (rests @ np.linalg.inv(cov) * rests).sum(axis=1) / size
        weight = 1.0 / (1.0 + np.maximum(far / max(float(np.median(far)), 1e-9) - 1.0, 0.0) ** 2)
    return cov


@dataclass(frozen=True)
class InkShares:
    """Share, offset and width of ink measured in strips.

    Attributes
    ----------
    share, u_share : (n,) float64
        Share of the line's ink, and its standard uncertainty by the strip's noise.
    offset, widening : (n,) float64, widths
        Offset of a line to the left of its place, and its relative widening.
    misfit : (n,) float64
        Mean square of what is left, over noise.
    """

    share: FloatArray
    u_share: FloatArray
    offset: FloatArray
    widening: FloatArray
    misfit: FloatArray

    @staticmethod
    def blank(count: int) -> InkShares:
        """Return an empty table for ``count`` places, filled by `put`."""
        return InkShares(*np.zeros((5, count)))

    def put(self, rows: BoolArray | IntArray, part: InkShares) -> None:
        """Copy the values of ``part`` into some rows."""
        for name, values in vars(part).items():
            getattr(self, name)[rows] = values

    def over(self, level: float) -> InkShares:
        """Return shares relative to a level."""
        return replace(self, share=self.share / level, u_share=self.u_share / level)


def sample_strips(
    image: FloatImage, projected: ProjectedSamples, samples: PathSamples
) -> FloatArray:
    """Return samples across each place, (n, u, c)."""
    across = samples.width[:, None] * ACROSS_WIDTHS
    each = [
        projected.profiles(np.ascontiguousarray(image[:, :, c]), across)
        for c in range(image.shape[2])
    ]
    return np.stack(each, axis=2).astype(np.float64)


def full_ink_profile(model: InkModel, over: FloatArray, projected: ProjectedSamples) -> FloatArray:
    """Return what full ink adds to each strip, (n, u, c); ``over`` (n, u) is older ink below."""
    normal = projected.across / np.maximum(
        np.linalg.norm(projected.across, axis=1, keepdims=True), 1e-9
    )
    ground, part = model.at(0, ACROSS_WIDTHS, normal), over[:, :, None]
    if not over.any():
        return ground
    return np.asarray(ground * (1.0 - part) + model.at(1, ACROSS_WIDTHS, normal) * part)


def measure_shares(
    strips: FloatArray, own: FloatArray, noise: StripNoise, lost: BoolArray | None = None
) -> InkShares:
    """Fit share, offset and widening to strips (n, u, c) that hold the line's own ink alone.

    Samples that are ``lost`` (n, u) aren't used: the fewer are left, the larger is the uncertainty.
    """
    n, sample_count, channels = strips.shape
    if lost is None or not lost.any():
        return _fit_strips(strips, own, noise.inverse, sample_count * channels)
    found = InkShares.blank(n)
    for rows, inverse, number in group_by_lost_samples(noise.inverse, lost):
        found.put(rows, _fit_strips(strips[rows], own[rows], inverse, max(number, 1)))
    return found


def group_by_lost_samples(
    inverse: FloatArray, lost: BoolArray
) -> Iterator[tuple[IntArray, FloatArray, int]]:
    """Group strips by which of their samples are ``lost`` (n, u).

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


def remove_line_terms(rests: FloatArray, own: FloatArray) -> FloatArray:
    """Remove from rests (n, u c) what the line's own share, place and width explain.

    A thin stretch of a layer is no noise of its others.
    """
    basis = _basis(own)[:, ::2]
    power = np.einsum("nij,nkj->nik", basis, basis)
    power += 1e-9 * (1.0 + power.max(initial=0.0)) * np.eye(2)
    found = np.linalg.solve(power, np.einsum("nij,nj->ni", basis, rests)[:, :, None])
    return np.asarray(rests - np.einsum("ni,nij->nj", found[:, :, 0], basis))


def _basis(own: FloatArray) -> FloatArray:
    """Return the derivatives of strips by share, offset and widening, (n, 3, u c)."""
    slope = np.gradient(own, ACROSS_WIDTHS[1] - ACROSS_WIDTHS[0], axis=1)
    terms = np.stack([own, -slope, -slope * ACROSS_WIDTHS[None, :, None]], axis=1)
    return np.asarray(terms.reshape(len(own), 3, own.shape[1] * own.shape[2]))


def _fit_strips(
    strips: FloatArray, own: FloatArray, inverse: FloatArray, sample_count: int
) -> InkShares:
    """Fit strips by one inverse covariance over ``sample_count`` samples."""
    n = len(strips)
    basis = _basis(own)
    flat = strips.reshape(n, -1)
    weighted = basis @ inverse
    power = weighted @ basis.transpose(0, 2, 1)
    score = np.einsum("nij,nj->ni", weighted, flat)
    # Offset and widening scale with the share; the designed line is the prior.
    power[:, 1, 1] += _OFFSET_SD_WIDTHS**-2
    power[:, 2, 2] += _WIDENING_SD**-2
    power[:, 0, 0] += 1e-9
    cov = np.linalg.inv(power)
    found = np.einsum("nij,nj->ni", cov, score)
    left = flat - np.einsum("ni,nij->nj", found, basis)
    misfit = (left @ inverse * left).sum(axis=1) / sample_count
    return InkShares(found[:, 0], np.sqrt(cov[:, 0, 0]), found[:, 1], found[:, 2], misfit)
