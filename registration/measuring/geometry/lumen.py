"""Filtered axis and wall of one printed vessel, from its cross-sections."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.alignment import Fit
from registration.measuring.gauging.outlines import Outlines
from registration.measuring.geometry.filters import (
    closed_filtered,
    closed_transmission,
    open_filter,
)
from registration.measuring.geometry.line import Line
from registration.measuring.geometry.section_noise import middle_noise, wall_spectrum

UNDULATIONS = 7.0
"""Cut-off round a section, undulations per revolution."""
LEAST_MET = 0.9
"""Of a section's rays that must have met the wall."""
LEAST_SECTIONS = 7
DRAWS = 100


@dataclass(frozen=True)
class Lumen:
    """Whole sections of a vessel, (n,) of them.

    Attributes
    ----------
    line : Line
        As designed.
    along : (n,) float64, mm
        From the first node.
    raw, middle : (n, 3) float64, mm
        Centroids, as measured and filtered along the axis.
    wall : (n, rays, 3) float64, mm
        Filtered round each section and along the axis.
    filter : (n, n) float64
        That filter.
    noise_mm : float, mm
        Of one coordinate of a raw centroid, standard deviation.
    spectrum : (rays // 2 + 1,) float64, mm
        Standard deviation of the raw wall's noise by harmonic (of real and imaginary part).
    ray_count : int
    correlation_mm : float, mm
        Sections nearer than this share noise.
    """

    line: Line
    along: FloatArray
    raw: FloatArray
    middle: FloatArray
    wall: FloatArray
    filter: FloatArray
    noise_mm: float
    spectrum: FloatArray
    ray_count: int
    correlation_mm: float

    def shared(self, weights: FloatArray) -> float:
        """Standard deviation that noise leaves in a weighted sum of centroids' coordinates, mm."""
        apart = np.abs(self.along[:, None] - self.along) / max(self.correlation_mm, 1e-9)
        square = float(weights @ np.exp(-(apart**2)) @ weights)
        return self.noise_mm * float(np.sqrt(max(square, 0.0)))

    def drawn_walls(self, rng: np.random.Generator) -> FloatArray:
        """Noise of the filtered wall alone, radial, (`DRAWS`, n, rays), mm."""
        keep = closed_transmission(self.ray_count, UNDULATIONS) * self.spectrum
        shape = (DRAWS, len(self.along), len(keep))
        waves = keep * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
        return np.asarray(self.filter @ np.fft.irfft(waves, self.ray_count, axis=-1))

    def drawn_middles(self, rng: np.random.Generator) -> FloatArray:
        """Noise of the filtered centroids across the vessel, (`DRAWS`, n, 2), mm."""
        drawn = self.noise_mm * rng.standard_normal((DRAWS, len(self.along), 2))
        return np.asarray(self.filter @ drawn)


def lumen(
    line: Line,
    along: FloatArray,
    outlines: Outlines,
    ray_noise_mm: FloatArray,
    fit: Fit,
    blur_mm: float,
) -> Lumen | None:
    """Return a vessel's axis and wall by its whole sections; None where they are too few.

    Parameters
    ----------
    line : Line
        As designed.
    along : (n,) float64, mm
    outlines : Outlines
        Of n sections.
    ray_noise_mm : (n,) float64, mm
        Standard error of each diameter.
    fit : Fit
        Scan to part.
    blur_mm : float, mm
    """
    met = np.asarray(np.isfinite(outlines.wall).all(axis=-1))
    kept = met.mean(axis=1) >= LEAST_MET
    if kept.sum() < LEAST_SECTIONS:
        return None
    planes, middle, where = outlines.planes, outlines.middle[kept], along[kept]
    here = _Placed(planes.centre[kept], planes.across[kept], fit)
    rays = _rays(outlines.wall[kept], middle, met[kept])
    smooth = open_filter(where, 2 * float(line.nearest(fit.apply(here.centre))[1].mean()))
    filtered = (smooth @ middle)[:, None]
    wall = filtered + (smooth @ closed_filtered(rays, UNDULATIONS))[..., None] * _circle(rays)
    noise = np.maximum(middle_noise(middle), np.nanmedian(ray_noise_mm[kept]) / np.sqrt(2))
    return Lumen(
        line,
        where,
        here.places(middle[:, None])[:, 0],
        here.places(filtered)[:, 0],
        here.places(wall),
        smooth,
        float(noise),
        wall_spectrum(rays, middle),
        rays.shape[1],
        max(2 * np.sqrt(np.pi) * blur_mm, 0.5 * float(np.median(np.diff(where)))),
    )


@dataclass(frozen=True)
class _Placed:
    """Sections' planes: centres (n, 3), mm, and directions (n, 2, 3), in the scan's frame."""

    centre: FloatArray
    across: FloatArray
    fit: Fit

    def places(self, flat: FloatArray) -> FloatArray:
        """In-plane positions (n, m, 2) to places (n, m, 3) of the part, mm."""
        places = self.centre[:, None] + np.einsum("nmi,nij->nmj", flat, self.across)
        return self.fit.apply(places.reshape(-1, 3)).reshape(places.shape)


def _rays(wall: FloatArray, middle: FloatArray, met: NDArray[np.bool_]) -> FloatArray:
    """Lengths of rays (n, rays) from the centroids; where one met no wall, their mean."""
    lengths = np.linalg.norm(wall - middle[:, None], axis=-1)
    return np.asarray(np.where(met, lengths, np.nanmean(lengths, axis=1)[:, None]))


def _circle(rays: FloatArray) -> FloatArray:
    """Directions of rays, (rays, 2)."""
    angle = 2 * np.pi * np.arange(rays.shape[1]) / rays.shape[1]
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
