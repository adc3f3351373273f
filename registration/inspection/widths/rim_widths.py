"""Fit a bright or dark rim to cross-profiles of an OCT's filaments; widths from rim to rim.

Clear hydrogel scatters at its boundary and hardly inside. A picture of a filament (`own_depth`) is
then the mean, over a part of the height, of a round shell around a core of another level, blurred
by the scanner and by the average over speckle. Diameter, thickness of the shell and blur are tried
on a grid; for each the levels of shell, core and ground are linear. The weights of all that fit
(Gaussian noise, as large as the best fit leaves) give the diameter and its uncertainty: a shell
thinner than the blur doesn't tell its thickness, and the diameter is less sure by that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from registration.inspection.ink.ink_image import ACROSS
from registration.inspection.ink.rims import LOBE, lobe
from registration.inspection.values import FloatImage

MOST_MISFIT: Final = 0.1
"""Root mean square of what a fit leaves, of the profile's height: more is no rim's."""
_NEAR: Final = 1.2
"""Expected widths from the middle, over which is fitted."""
_DIAMETERS: Final = np.linspace(0.6, 1.5, 46)
_SHELLS: Final = np.array([0.04, 0.1, 0.16, 0.22, 0.28, 0.34, 0.4, 0.5, 0.6, 0.8])
"""Twice a shell's thickness, of the diameter."""
_BLURS: Final = np.array([0.0, *np.geomspace(0.02, 0.25, 15)])
"""Of an expected width, beyond the least blur."""
_BEYOND: Final = 1.0
"""And so far, where ink ends."""
_PLACES: Final = np.linspace(-1.6, 1.6, 241)
"""Of a filament that is computed, expected widths."""
_TOGETHER: Final = 6.0
"""Neighbouring places of a profile that aren't independent."""
_LEAST_RMS: Final = 0.02
"""Of the profile's height: no filament is rounder, no rim more even."""


@dataclass(frozen=True)
class Rim:
    """A rim fitted to a mean profile, in expected widths.

    Attributes
    ----------
    diameter, u_diameter : float
        Outer diameter and its standard uncertainty.
    misfit : float
        Root mean square of what stays, of the profile's height.
    """

    diameter: float
    u_diameter: float
    misfit: float


def rim_edges(profiles: FloatImage, mean: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where profiles (m, 61) fall to half of their rims: left, right, and the slope there, (m,).

    ``mean`` (61,) is even; in expected widths, slopes per width.
    """
    sign, height = lobe(mean)
    strength = np.clip(profiles @ mean / float(mean @ mean), 0.4, 2.5)
    left, right = (_outer(sign * profiles[:, ::way], 0.5 * height * strength) for way in (1, -1))
    return left[0], right[0], np.minimum(left[1], right[1])


def _outer(values: FloatImage | FloatArray, level: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Outermost place to the right at which values (m, 61) exceed a level (m,), and the slope."""
    step, rows = float(ACROSS[1] - ACROSS[0]), np.arange(len(values))
    side = (LOBE[0] <= ACROSS) & (ACROSS <= _BEYOND)
    above = side & (values > level[:, None])
    k = np.where(above.any(axis=1), len(ACROSS) - 1 - above[:, ::-1].argmax(axis=1), -1)
    inner = np.clip(k, 0, len(ACROSS) - 2)
    drop = values[rows, inner] - values[rows, inner + 1]
    part = np.clip((values[rows, inner] - level) / np.maximum(drop, 1e-9), 0.0, 1.0)
    near, far = np.maximum(inner - 1, 0), np.minimum(inner + 2, len(ACROSS) - 1)
    slope = (values[rows, near] - values[rows, far]) / (step * (far - near))
    return np.where(k >= 0, ACROSS[inner] + part * step, np.nan), slope


def fit_rim(mean: FloatArray, least_blur: float, heights: Sequence[float]) -> Rim:
    """Fit a rim to an even mean profile (61,).

    Parameters
    ----------
    mean : (61,) float64
        Linear in brightness, bath 0.
    least_blur : float
        Standard deviation, expected widths, that the picture is blurred by at least.
    heights : sequence of float
        Of the expected width, over one of which the picture is a mean.
    """
    near = np.abs(ACROSS) <= _NEAR
    values = mean[near] / np.abs(mean[near]).max()
    away = ACROSS[near][:, None] - _PLACES
    sigma = np.hypot(_BLURS, least_blur)[:, None, None]
    blurred = np.exp(-0.5 * (away / sigma) ** 2)
    blurred /= blurred.sum(axis=2, keepdims=True)
    cost = np.array(
        [[_cost(values, blurred, one, h) for h in heights] for one in _DIAMETERS.tolist()]
    )
    square = max(float(cost.min()) / len(values), _LEAST_RMS**2)
    weight = np.exp(-0.5 * (cost - cost.min()) / (square * _TOGETHER)).sum(axis=(1, 2, 3))
    weight /= weight.sum()
    middle = float(weight @ _DIAMETERS)
    spread = float(np.sqrt(weight @ (_DIAMETERS - middle) ** 2))
    return Rim(middle, spread, float(np.sqrt(cost.min() / len(values))))


def _cost(values: FloatArray, blurred: FloatArray, diameter: float, height: float) -> FloatArray:
    """Sum of squares that the best levels leave, for all blurs and shells of a diameter."""
    inner = diameter * (1.0 - _SHELLS[:, None])
    whole, core = _chord(diameter, height), _chord(inner, height)
    shapes = np.stack([whole - core, core, np.ones_like(core)], axis=-1)
    seen = np.einsum("bup,spk->bsuk", blurred, shapes, optimize=True)
    power = np.einsum("bsuk,bsul->bskl", seen, seen) + 1e-9 * np.eye(3)
    by = np.einsum("bsuk,u->bsk", seen, values)
    levels = np.linalg.solve(power, by[..., None])[..., 0]
    return np.asarray(float(values @ values) - (levels * by).sum(axis=-1))


def _chord(diameter: FloatArray | float, height: float) -> FloatArray:
    """Way through a round filament at `_PLACES`, within the height that is averaged over."""
    square = np.asarray(diameter) ** 2 - (2.0 * _PLACES) ** 2
    return np.minimum(np.sqrt(np.maximum(square, 0.0)), height)
