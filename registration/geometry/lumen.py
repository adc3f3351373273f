"""Axis and wall of one vessel as printed, filtered, in the part's frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from registration.alignment import Fit
from registration.gauging.outlines import Outlines
from registration.geometry.filters import closed_filtered, closed_transmission, open_filter

FloatArray = NDArray[np.float64]

UNDULATIONS = 7.0
"""Cut-off round a section, undulations per revolution."""
LEAST_MET = 0.9
"""Of a section's rays that must have met the wall."""
LEAST_SECTIONS = 7
_LAG = 3
"""Sections between differences, fewer in a short vessel: closer ones share noise by the blur."""
_STRAIGHT_MM = 0.002
"""A design that leaves a straight line, or one radius, by less has none but rounding."""
DRAWS = 100


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
        chord = _unit(points[-1] - points[0])
        off = points - points[0] - ((points - points[0]) @ chord)[:, None] * chord
        length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        before = points[0] - _unit(points[1] - points[0])
        after = points[-1] - _unit(points[-2] - points[-1])
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
            return self.points[-2], _unit(way), float(self.radius[-1])
        return self.points[1], _unit(self.points[0] - self.points[1]), float(self.radius[0])

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
    planes, where = outlines.planes, along[kept]
    centre, across, middle = planes.centre[kept], planes.across[kept], outlines.middle[kept]
    found = np.linalg.norm(outlines.wall[kept] - middle[:, None], axis=-1)
    rays = np.asarray(np.where(met[kept], found, np.nanmean(found, axis=1)[:, None]))
    designed = 2 * float(line.nearest(fit.apply(centre))[1].mean())
    smooth = open_filter(where, designed)
    step = float(np.median(np.diff(where)))
    noise = np.maximum(_noise(middle), np.nanmedian(ray_noise_mm[kept]) / np.sqrt(2))
    angle = 2 * np.pi * np.arange(rays.shape[1]) / rays.shape[1]
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    flat = (smooth @ middle)[:, None] + (smooth @ closed_filtered(rays, UNDULATIONS))[
        ..., None
    ] * circle
    wall = fit.apply(_placed(centre, across, flat).reshape(-1, 3)).reshape(*flat.shape[:2], 3)
    return Lumen(
        line,
        where,
        fit.apply(_placed(centre, across, middle[:, None])[:, 0]),
        fit.apply(_placed(centre, across, (smooth @ middle)[:, None])[:, 0]),
        wall,
        smooth,
        float(noise),
        _spectrum(rays, middle),
        rays.shape[1],
        max(2 * np.sqrt(np.pi) * blur_mm, 0.5 * step),
    )


def _placed(centre: FloatArray, across: FloatArray, flat: FloatArray) -> FloatArray:
    """Places (n, m, 3) of in-plane positions (n, m, 2)."""
    return np.asarray(centre[:, None] + np.einsum("nmi,nij->nmj", flat, across))


def _noise(middle: FloatArray) -> float:
    """Standard deviation of one coordinate (n, 2), by differences along the vessel."""
    # Of two normal coordinates the squares' sum is exponential: its median is 2 ln 2 variances.
    return float(np.sqrt(np.median((_differences(middle) ** 2).sum(axis=1)) / (2 * np.log(2))))


def _spectrum(rays: FloatArray, middle: FloatArray) -> FloatArray:
    """Noise of each harmonic of the wall (n, rays), by differences along the vessel.

    Rays start at the centroid, so that the first harmonic is the centroid's own noise.
    """
    power = np.median(np.abs(_differences(np.fft.rfft(rays, axis=1))) ** 2, axis=0)
    # Real and imaginary part have equal variance: exponential; the mean has one part alone.
    spread = np.sqrt(power / (2 * np.log(2)))
    spread[0] = np.sqrt(power[0] / 0.455)
    spread[1] = _noise(middle) * rays.shape[1] / 2
    return np.asarray(spread)


def _differences(values: NDArray[Any]) -> NDArray[Any]:
    """Second differences over (n, k), with the variance of one value: a slope has none."""
    lag = min(_LAG, (len(values) - 1) // 3)
    found = values[: -2 * lag] - 2 * values[lag:-lag] + values[2 * lag :]
    return np.asarray(found / np.sqrt(6))


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))
