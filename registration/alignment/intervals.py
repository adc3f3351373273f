"""How sure a fit's parameters are.

Two things move them. Noise: neighbouring surface points err together, so what counts is patches,
not points; the covariance that a bootstrap of patches would find is had without drawing (the
sandwich of White 1980, 10.2307/1912934, clustered by patch). And what repeats in every scan of a
kind: a wall's place depends a little on how it faces the light. No resampling shows that. Each
direction of walls, and lumens apart from outer faces, gets an error of its own, a small part of the
blur under which the surface was found; and all walls together one along the light.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from registration.alignment.fit import Fit, Freedom, Linearised, facing, linearised
from registration.distance import ModelSurface

FloatArray = NDArray[np.float64]

PATCH_MM = 0.5
"""Points of one cell of this edge err together."""
OWN, ALONG_LIGHT = 0.02, 0.025
"""Standard deviations of a wall's repeatable error, as parts of the blur: of each direction, and
along the light of all walls (set on phantoms under three lights, held against others)."""
NORMAL_95 = 1.96


@dataclass(frozen=True)
class Uncertainty:
    """Half widths of 95 % intervals; NaN for what wasn't fitted.

    Attributes
    ----------
    rotation_deg : (3,) float64, °
        About the part's x, y, z through its middle.
    shift_mm : (3,) float64, mm
        Of the part's middle.
    scale : (3,) float64
        Of the print's size over the design's.
    offset_mm : float, mm
    """

    rotation_deg: FloatArray
    shift_mm: FloatArray
    scale: FloatArray
    offset_mm: float


def covariance(
    surface: ModelSurface, points: FloatArray, fit: Fit, freedom: Freedom, blur_mm: float
) -> FloatArray:
    """Covariance (k, k) of a converged fit's parameters, in `Linearised`'s order, rad and mm."""
    step = linearised(surface, points, fit, freedom, blur_mm=blur_mm, even=True)
    bread = np.linalg.inv(step.normal)
    scores = step.jacobian * (step.weight * step.residual)[:, None]
    patch = _numbers(np.floor(fit.apply(points) / PATCH_MM).astype(np.int64))
    noise = _summed(scores, patch)
    count = len(noise)
    systematic = blur_mm * _repeatable(step, fit.rotation[:, 2])
    middle = count / max(count - 1, 1) * noise.T @ noise + systematic.T @ systematic
    return np.asarray(bread @ middle @ bread)


def uncertainty(
    surface: ModelSurface, points: FloatArray, fit: Fit, freedom: Freedom, blur_mm: float
) -> Uncertainty:
    """95 % intervals of a converged fit to scanned points (n, 3)."""
    spread = covariance(surface, points, fit, freedom, blur_mm)
    half = NORMAL_95 * np.sqrt(np.diag(spread))
    scale = np.full(3, np.nan)
    for number, axis in enumerate(freedom.axes):
        scale[axis] = half[6 + number] / fit.stretch[axis]
    return Uncertainty(
        rotation_deg=np.rad2deg(half[:3]),
        shift_mm=half[3:6],
        scale=scale,
        offset_mm=float(half[-1]) if freedom.offset else float("nan"),
    )


def _repeatable(step: Linearised, beam: FloatArray) -> FloatArray:
    """What a standard deviation of each repeatable error pulls at, per unit of blur, (g, k)."""
    pulls = step.jacobian * step.weight[:, None]
    own = _summed(pulls, _numbers(facing(step.direction, step.bends)[:, None]))
    along = (step.direction @ beam) @ pulls
    return np.vstack([OWN * own, ALONG_LIGHT * along])


def _numbers(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number of the distinct row that each row is."""
    _, found = np.unique(keys, axis=0, return_inverse=True)
    return np.asarray(found).reshape(-1)


def _summed(values: FloatArray, group: NDArray[np.int64]) -> FloatArray:
    """Sums of rows (n, k) over groups, (g, k)."""
    columns = [np.bincount(group, column) for column in values.T]
    return np.stack(columns, axis=1)
