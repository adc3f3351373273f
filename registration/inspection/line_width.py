"""Widths of lines, over the bath and free on both sides.

What a profile says of the layer's usual width follows from its shape: ink that covers what lies
below, ink that takes light by its thickness, rims, or heights; each blurred. The shape that fits
best tells the width, the others how sure that is. Against the usual width each station's own is
found by Gauss and Newton's method: its share of ink, offset and width, without any prior.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import ndtr

from kernels.arrays import BoolArray, FloatArray
from registration.inspection.ink_model import NODES, InkModel
from registration.inspection.passes import REACH
from registration.inspection.shares import ACROSS, sampled

_RATIOS: Final = np.arange(0.5, 1.6, 0.01)
"""Widths over expected ones that are tried."""
_BLURS: Final = np.array([0.03, 0.05, 0.07, 0.1, 0.13, 0.17, 0.22])
"""Standard deviations of blur, widths."""
_FINE: Final = np.linspace(0.0, 2.2, 441)
_ROUNDS: Final = 4
_COMMON: Final = 0.02
"""Least relative uncertainty of a shape's width: nodes are a tenth of a width apart."""
_AS_GOOD: Final = 2.0
"""Times the best one's misfit, up to which another shape counts."""
_INDEPENDENT: Final = 0.4
"""Of the places of a station: neighbours share noise."""


@dataclass(frozen=True)
class Widths:
    """Widths at stations.

    Attributes
    ----------
    width_mm, random_mm : (m,) float64, mm
        Width, and what of its uncertainty differs from station to station; NaN where not told.
    offset_mm : (m,) float64, mm
        Of the middle, to the left.
    common : float
        Relative standard uncertainty of all widths together.
    seam_share : (m,) float64
        Share of ink of lines that touch; NaN elsewhere.
    """

    width_mm: FloatArray
    random_mm: FloatArray
    offset_mm: FloatArray
    common: float
    seam_share: FloatArray

    @property
    def u_mm(self) -> FloatArray:
        """Standard uncertainty of each, (m,), mm."""
        return np.hypot(self.random_mm, self.common * self.width_mm)


def usual_ratio(model: InkModel) -> tuple[float, float]:
    """Width over the expected one that a look's profile shows, and its relative uncertainty."""
    even = model.profile[0, 0]  # (nodes, c)
    weight = np.linalg.svd(even, full_matrices=False)[2][0]
    profile = even @ weight
    at = np.arange(NODES + 1) * (REACH / NODES)
    fits = [_fitted(kind, profile, at) for kind in ("cover", "chord", "rim")]
    best = min(fits)
    near = [one for one in fits if one[0] < _AS_GOOD * best[0] + 1e-12]
    apart = max(abs(one[1] - best[1]) for one in near)
    return best[1], max(math.sqrt(best[0]), apart / math.sqrt(3.0), _COMMON)


def _fitted(kind: str, profile: FloatArray, at: FloatArray) -> tuple[float, float]:
    """Relative misfit and width of the best of a kind of shape."""
    total = float((profile**2).sum())
    best = (math.inf, 1.0)
    for blur in _BLURS:
        for ratio in _RATIOS:
            shapes = np.stack([_shape(one, at, ratio, blur) for one in _terms(kind)])
            power = shapes @ shapes.T + 1e-9 * np.eye(len(shapes))
            found = np.linalg.solve(power, shapes @ profile)
            rest = float(((profile - found @ shapes) ** 2).sum()) / max(total, 1e-12)
            best = min(best, (rest, float(ratio)))
    return best


def _terms(kind: str) -> tuple[str, ...]:
    return {"cover": ("cover",), "chord": ("chord",), "rim": ("cover", "ring")}[kind]


def _shape(kind: str, at: FloatArray, ratio: float, blur: float) -> FloatArray:
    """A blurred profile at distances, widths."""
    half = 0.5 * ratio
    if kind == "cover":
        return np.asarray(ndtr((half - at) / blur) - ndtr((-half - at) / blur))
    if kind == "ring":
        middle = 0.9 * half
        return np.asarray(
            np.exp(-0.5 * ((at - middle) / (blur + 0.04)) ** 2)
            + np.exp(-0.5 * ((at + middle) / (blur + 0.04)) ** 2)
        )
    # A chord's blur, by Gauss and Hermite's five nodes.
    nodes = np.array([-2.0202, -0.9586, 0.0, 0.9586, 2.0202]) * math.sqrt(2.0)
    weights = np.array([0.01995, 0.39362, 0.94531, 0.39362, 0.01995]) / 1.77245
    off = (at[:, None] + blur * nodes) / half
    return np.asarray((np.sqrt(np.clip(1.0 - off**2, 0.0, None)) * weights).sum(axis=1))


def station_widths(
    strips: FloatArray,
    own: FloatArray,
    places: FloatArray,
    expected_mm: FloatArray,
    tell: BoolArray,
    noise: FloatArray,
    usual: tuple[float, float],
    seam_share: FloatArray,
) -> Widths:
    """Measure stations that tell a width.

    Parameters
    ----------
    strips, own : (m, u, c) float64
        Mean strips, and full ink's profile there.
    places : (m,) float64
        Places in each.
    expected_mm : (m,) float64, mm
    tell : (m,) bool
    noise : (u c, u c) float64
        Inverse covariance of one strip.
    usual : (float, float)
        Of `usual_ratio`.
    seam_share : (m,) float64
    """
    count = len(expected_mm)
    nothing = np.full(count, np.nan)
    rows = np.flatnonzero(tell & np.isfinite(strips).all(axis=(1, 2)))
    if not len(rows):
        return Widths(nothing, nothing, nothing, usual[1], seam_share)
    share, off, wide = np.ones(len(rows)), np.zeros(len(rows)), np.ones(len(rows))
    cov = np.zeros((len(rows), 3, 3))
    for _ in range(_ROUNDS):
        at = (ACROSS[None, :] - off[:, None]) / wide[:, None]
        shape, slope = sampled(own[rows], at)
        basis = np.stack(
            [
                shape,
                -share[:, None, None] * slope / wide[:, None, None],
                -share[:, None, None] * slope * at[:, :, None] / wide[:, None, None],
            ],
            axis=1,
        ).reshape(len(rows), 3, -1)
        rest = (strips[rows] - share[:, None, None] * shape).reshape(len(rows), -1)
        weighted = basis @ noise
        power = np.einsum("nij,nkj->nik", weighted, basis) + 1e-6 * np.eye(3)
        cov = np.linalg.inv(power)
        step = np.einsum("nij,nj->ni", cov, np.einsum("nij,nj->ni", weighted, rest))
        share = np.clip(share + step[:, 0], 0.1, 3.0)
        off = np.clip(off + step[:, 1], -0.3, 0.3)
        wide = np.clip(wide + step[:, 2], 0.4, 1.8)
    number = np.maximum(_INDEPENDENT * places[rows], 1.0)
    ratio, common = usual
    width, random, offset = nothing.copy(), nothing.copy(), nothing.copy()
    width[rows] = ratio * wide * expected_mm[rows]
    random[rows] = np.sqrt(cov[:, 2, 2] / number) * ratio * expected_mm[rows]
    offset[rows] = off * expected_mm[rows]
    return Widths(width, random, offset, common, seam_share)
