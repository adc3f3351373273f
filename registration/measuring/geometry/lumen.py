"""Filtered axis and wall of one printed vessel, from its cross-sections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.alignment import Fit
from registration.measuring.gauging.on_walls import Outlines

ALPHA = float(np.sqrt(np.log(2) / np.pi))
"""A wave of the cut-off's length keeps half of its amplitude (ISO 16610-21:2011, 4.2)."""


def closed_transmission(rays: int, cut_off: float) -> FloatArray:
    """Amplitude that each harmonic of a closed profile keeps, (rays // 2 + 1,).

    exp(-π (α k / k_c)²), k undulations per revolution, cut-off k_c (ISO 16610-21:2011, 4.3).
    """
    order = np.arange(rays // 2 + 1)
    return np.asarray(np.exp(-np.pi * (ALPHA * order / cut_off) ** 2))


def closed_filtered(profile: FloatArray, cut_off: float) -> FloatArray:
    """Return closed profiles (..., rays) without waves beyond the cut-off."""
    rays = profile.shape[-1]
    keep = closed_transmission(rays, cut_off)
    return np.fft.irfft(np.fft.rfft(profile, axis=-1) * keep, rays, axis=-1)


def cells(places: FloatArray, edge_mm: float) -> NDArray[np.int64]:
    """Number of the cube of `edge_mm` that each place (n, 3) lies in, from 0 without gaps."""
    index = np.floor(places / edge_mm).astype(np.int64)
    index -= index.min(axis=0)
    size = index.max(axis=0) + 1
    flat = (index[:, 0] * size[1] + index[:, 1]) * size[2] + index[:, 2]
    return np.asarray(np.unique(flat, return_inverse=True)[1]).reshape(-1)


def open_filter(along: FloatArray, cut_off: float, at: FloatArray | None = None) -> FloatArray:
    """Matrix (m, n) that filters values at n places `along` a line, for places `at` (its own).

    Weights exp(-π (x / (α λ))²) about a straight line fitted there: a slope passes whole, to the
    ends (ISO 16610-28:2016, moment criterion of first order). Where fewer than two places weigh
    the nearest counts.
    """
    at = along if at is None else at
    off = along - at[:, None]
    weight = np.exp(-np.pi * np.minimum((off / (ALPHA * cut_off)) ** 2, 200.0))
    weight = np.maximum(weight, 1e-12 * np.exp(-np.abs(off) / cut_off))
    s0, s1, s2 = ((weight * off**k).sum(axis=1)[:, None] for k in (0, 1, 2))
    det = s0 * s2 - s1**2
    line = weight * (s2 - s1 * off) / np.where(det > 1e-9 * s0 * s2, det, np.inf)
    return np.asarray(np.where(det > 1e-9 * s0 * s2, line, weight / s0))


_LAG = 3
"""Sections between differences, fewer in a short vessel: closer ones share noise by the blur."""


def middle_noise(middle: FloatArray) -> float:
    """Standard deviation of one coordinate (n, 2), by differences along the vessel."""
    # Of two normal coordinates the squares' sum is exponential: its median is 2 ln 2 variances.
    return float(np.sqrt(np.median((_differences(middle) ** 2).sum(axis=1)) / (2 * np.log(2))))


def wall_spectrum(rays: FloatArray, middle: FloatArray) -> FloatArray:
    """Noise of each harmonic of the wall (n, rays), by differences along the vessel.

    Rays start at the centroid, so that the first harmonic is the centroid's own noise.
    """
    power = np.median(np.abs(_differences(np.fft.rfft(rays, axis=1))) ** 2, axis=0)
    # Real and imaginary part have equal variance: exponential; the mean has one part alone.
    spread = np.sqrt(power / (2 * np.log(2)))
    spread[0] = np.sqrt(power[0] / 0.455)
    spread[1] = middle_noise(middle) * rays.shape[1] / 2
    return np.asarray(spread)


def _differences(values: NDArray[Any]) -> NDArray[Any]:
    """Second differences over (n, k), with the variance of one value: a slope has none."""
    lag = min(_LAG, (len(values) - 1) // 3)
    differences = values[: -2 * lag] - 2 * values[lag:-lag] + values[2 * lag :]
    return np.asarray(differences / np.sqrt(6))


_STRAIGHT_MM = 0.002
"""A design that leaves a straight line, or one radius, by less has none but rounding."""


@dataclass(frozen=True)
class Line:
    """A designed axis.

    Attributes
    ----------
    points : (k, 3) float64, mm
        Polyline, its ends carried on by a millimetre.
    radius : (k,) float64, mm
    length : float, mm
        Without what was carried on.
    straight, even : bool
        Straight from end to end; of one radius.
    """

    points: FloatArray
    radius: FloatArray
    length: float
    straight: bool
    even: bool

    @staticmethod
    def of(network: VesselNetwork, vessel: int) -> Line:
        """Return a vessel's designed axis."""
        points, radius = network.polyline(vessel)
        chord = unit(points[-1] - points[0])
        off = points - points[0] - ((points - points[0]) @ chord)[:, None] * chord
        length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        before = points[0] - unit(points[1] - points[0])
        after = points[-1] - unit(points[-2] - points[-1])
        return Line(
            np.vstack([before, points, after]),
            np.concatenate([radius[:1], radius, radius[-1:]]),
            length,
            bool(np.linalg.norm(off, axis=1).max() < _STRAIGHT_MM),
            bool(np.ptp(radius) < _STRAIGHT_MM),
        )

    def end(self, last: bool) -> tuple[FloatArray, FloatArray, float]:
        """First or last node, the unit way there along the axis, and the radius."""
        if last:
            way = self.points[-1] - self.points[-2]
            return self.points[-2], unit(way), float(self.radius[-1])
        return self.points[1], unit(self.points[0] - self.points[1]), float(self.radius[0])

    def nearest(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points (n, 3) of the axis to places (n, 3), and the radii there (n,), mm."""
        best = np.full(len(places), np.inf)
        foot, radius = np.empty_like(places), np.empty(len(places))
        for a, b, ra, rb in zip(
            self.points, self.points[1:], self.radius, self.radius[1:], strict=False
        ):
            way = b - a
            t = np.clip((places - a) @ way / max(way @ way, 1e-18), 0.0, 1.0)
            here = a + t[:, None] * way
            away = ((places - here) ** 2).sum(axis=1)
            nearer = away < best
            best = np.where(nearer, away, best)
            foot[nearer], radius[nearer] = here[nearer], (ra + t * (rb - ra))[nearer]
        return foot, radius


def unit(vector: FloatArray) -> FloatArray:
    """Return a vector's direction."""
    return np.asarray(vector / np.linalg.norm(vector))


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
