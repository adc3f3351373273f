"""Fit ink absorption and picture blur to line profiles; turn half-level widths into diameters.

A filament of dyed ink that light goes through takes away 1 − e^(−μ c), c = 2√(r² − t²) the way
through it at the distance t from its middle (Beer and Lambert). With a large μ that is a box, the
shade of an opaque one; with a small μ half an ellipse, whose width at half level is 0.87 d. The
picture's sharpness is a Gaussian of σ. μ and σ are one for the whole picture; they are fitted to
the mean profiles of a few lines, with a diameter, place, height and ground of each (variable
projection: height and ground are linear). What half level means then follows.

Not modelled: light that the filament bends (a clear one in a clear bath has dark edges and a bright
middle), glare, a camera that isn't linear. A misfit says so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import least_squares

from kernels.arrays import FloatArray

_CELLS: Final = 30
"""Steps of a computed profile in a radius, at least."""
_STARTS: Final = (0.3, 3.0, 30.0)
_OPAQUE: Final = 300.0
"""μ d of what is taken as opaque."""
MIDDLE: Final = 0.1
"""Half of the part of a profile, of its width, whose mean is its height."""


@dataclass(frozen=True)
class Shade:
    """A picture's optics.

    Attributes
    ----------
    per_mm : float, 1/mm
        μ.
    blur_mm : float, mm
        σ.
    misfit : float
        Root mean square of what stays, of a profile's height.
    spread : float
        Relative deviation of all diameters together: μ and σ are known no better.
    smoothed_mm : float, mm
        Part of σ that measuring put in against noise.
    """

    per_mm: float
    blur_mm: float
    misfit: float
    spread: float = 0.0
    smoothed_mm: float = 0.0

    @property
    def picture_blur_mm(self) -> float:
        """σ of the picture itself."""
        return math.sqrt(max(self.blur_mm**2 - self.smoothed_mm**2, 0.0))

    @property
    def least_gap_mm(self) -> float:
        """Narrowest gap between opaque lines whose middle falls below half level.

        There it is 2 − 2Φ(g/2σ) of the ink's height, Φ the normal distribution: g = 1.35 σ.
        """
        return 1.35 * self.picture_blur_mm

    def half_width(self, diameter_mm: FloatArray) -> FloatArray:
        """Width at half level of filaments, (n,), mm."""
        return np.array([_half_width(float(d), self.per_mm, self.blur_mm) for d in diameter_mm])

    def diameter(self, half_width_mm: FloatArray) -> FloatArray:
        """Diameter from widths at half level, (n,), mm; NaN stays."""
        known = half_width_mm[np.isfinite(half_width_mm)]
        if not len(known):
            return half_width_mm
        low, high = max(float(known.min()) * 0.6, 1e-4), float(known.max()) * 1.4
        grid = np.geomspace(low, high, 40)
        diameter = np.interp(half_width_mm, np.maximum.accumulate(self.half_width(grid)), grid)
        return np.where(np.isfinite(half_width_mm), diameter, np.nan)

    def opaque(self, diameter_mm: float) -> bool:
        """Whether a filament of that diameter lets no light through its middle (95 %)."""
        return self.per_mm * diameter_mm > 3.0


def shade_profile(
    across_mm: FloatArray, diameter_mm: float, per_mm: float, blur_mm: float
) -> FloatArray:
    """Shade of a filament at distances from its middle, (n,), 0 to 1."""
    # Edges lie half a step between two samples, so that a box is as wide as it should be.
    cells = min(max(_CELLS, math.ceil(diameter_mm / max(blur_mm, 1e-9))), 10 * _CELLS)
    step = diameter_mm / (2 * cells)
    beyond = math.ceil(5 * blur_mm / step) + 2
    fine = (np.arange(-cells - beyond, cells + beyond) + 0.5) * step
    way = 2 * np.sqrt(np.maximum((diameter_mm / 2) ** 2 - fine**2, 0.0))
    shade = np.expm1(-per_mm * way) / math.expm1(-per_mm * diameter_mm)
    blurred = gaussian_filter1d(shade, blur_mm / step, mode="nearest", truncate=5.0)
    return np.asarray(np.interp(across_mm, fine, blurred, left=0.0, right=0.0))


def fit_shade(
    across_mm: FloatArray, profiles: Sequence[FloatArray], width_mm: Sequence[float], px_mm: float
) -> Shade:
    """Fit μ and σ to mean profiles of lines, middles at about 0.

    Parameters
    ----------
    across_mm : (m,) float64, mm
    profiles : sequence of (m,) float64
    width_mm : sequence of float, mm
        About, of each.
    px_mm : float, mm
        A pixel: the picture isn't sharper than a part of it.
    """
    typical = float(np.median(width_mm))
    scaled = [profile / max(float(profile.max()), 1e-12) for profile in profiles]

    def residuals(p: FloatArray) -> FloatArray:
        per, blur = math.exp(p[0]), math.exp(p[1])
        parts = []
        for k, profile in enumerate(scaled):
            diameter, middle = math.exp(p[2 + 2 * k]), p[3 + 2 * k]
            shade = shade_profile(across_mm - middle, diameter, per, blur)
            columns = np.column_stack([shade, np.ones(len(shade)), across_mm])
            best, *_ = np.linalg.lstsq(columns, profile, rcond=None)
            parts.append(columns @ best - profile)
        return np.concatenate(parts)

    lowest = None
    for start in _STARTS:
        begin = [math.log(start / typical), math.log(max(0.08 * typical, 0.5 * px_mm))]
        low = [math.log(0.05 / typical), math.log(0.15 * px_mm)]
        high = [math.log(_OPAQUE / typical), math.log(typical)]
        for width in width_mm:
            begin += [math.log(width), 0.0]
            low += [math.log(width / 3), -width]
            high += [math.log(width * 3), width]
        solved = least_squares(
            residuals, begin, bounds=(low, high), x_scale="jac", ftol=1e-6, max_nfev=40
        )
        if lowest is None or solved.cost < lowest.cost:
            lowest = solved
    assert lowest is not None  # there is a start
    rms = math.sqrt(2 * float(lowest.cost) / sum(map(len, scaled)))
    per_mm, blur_mm = math.exp(lowest.x[0]), math.exp(lowest.x[1])
    # Neighbouring samples of a blurred profile aren't independent.
    together = max(1.0, 3.5 * blur_mm / float(across_mm[1] - across_mm[0]))
    inverse = np.linalg.pinv(lowest.jac.T @ lowest.jac)
    variance = float(np.median(np.diag(inverse)[2::2])) * rms**2 * together
    return Shade(per_mm, blur_mm, rms, math.sqrt(variance))


def _half_width(diameter: float, per_mm: float, blur_mm: float) -> float:
    """Width at half of the middle's height, mm."""
    across = np.linspace(0, diameter / 2 + 4 * blur_mm, 400)
    shade = shade_profile(across, diameter, per_mm, blur_mm)
    height = float(shade[across <= MIDDLE * diameter].mean())
    below = int(np.argmax(shade < height / 2))
    if below == 0:
        return 2 * float(across[-1])
    part = (shade[below - 1] - height / 2) / (shade[below - 1] - shade[below])
    return 2 * float(across[below - 1] + part * (across[below] - across[below - 1]))
