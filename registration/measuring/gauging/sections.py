"""Measure a lumen's cross-sections in planes across its axis, by rays to the wall."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from scipy.special import ndtri

from kernels import pjit
from kernels.arrays import BoolArray, FloatArray
from registration.segmentation.volume import GelField, Volume, trilinear


@pjit
def first_walls(
    values: Volume,
    sign: float,
    level: float,
    origin: FloatArray,
    voxel: FloatArray,
    centre: FloatArray,
    across: FloatArray,
    shift: FloatArray,
    circle: FloatArray,
    along: FloatArray,
    step: float,
) -> FloatArray:
    """Distance along each ray at which `sign` * value first rises through `level`, (n, r), mm.

    NaN where it doesn't, or only beyond the field. Straight between samples.

    Parameters
    ----------
    values : (nz, ny, nx) float32 or uint16
        Of a field with its `origin` and `voxel` (3,), mm.
    centre, across, shift : (n, 3), (n, 2, 3), (n, 2) float64, mm
        Planes, their directions, and where in them the rays start.
    circle : (r, 2) float64
        Directions of the rays in the planes.
    along : (k,) float64, mm
        Distances that are looked at, `step` from each other.
    """
    out = np.full((len(centre), len(circle)), np.nan)
    for n in numba.prange(len(centre)):
        where = np.empty(3)
        for r in range(len(circle)):
            low = math.nan
            for k in range(len(along)):
                first = shift[n, 0] + along[k] * circle[r, 0]
                second = shift[n, 1] + along[k] * circle[r, 1]
                for c in range(3):
                    place = centre[n, c] + first * across[n, 0, c] + second * across[n, 1, c]
                    where[c] = (place - origin[c]) / voxel[c]
                high = sign * trilinear(values, where[0], where[1], where[2]) - level
                if low < 0.0 and high >= 0.0:
                    out[n, r] = along[k - 1] + step * low / (low - high)
                    break
                low = high
    return out


RAYS = 48
LEAST_MET = 0.9
"""Of the rays must have met the wall of a whole section."""
REACH = 2.0
"""Rays go out to this many designed radii; what isn't met by then is another lumen."""
_MAD = 1.4826
"""Standard deviation over median absolute deviation, of normal noise."""
_HIGHEST = 0.95
"""Quantile among the rays that met a wall, above which the median of all isn't sought."""
_THIN_GEL = 0.5
"""Standard uncertainty, in blurs, of a median beside gel too thin to be a wall. Blur moves what is
left of such a wall outwards, and the more the more of the wall is thin. Where rays agree: 0.2 RMS,
computed of round lumens with one to four others 0.1 to 2 blurs beside them (blurs of 0.15 to 0.5
radii); 0.56 RMS with speckle, 120 sections of 11 scans of the shared generator."""
_AGREE = 0.05
"""Scatter of the rays, in radii, beyond which some are of other lumens' walls, or the lumen is far
from round. The error of those scans grew with about its square: 0.9 blurs RMS at 0.05 to 0.075, 1.5
to 0.1, 2.3 beyond."""


@dataclass(frozen=True)
class Planes:
    """Where to cut: n planes across a centreline, in the scan's frame.

    Attributes
    ----------
    centre : (n, 3) float64, mm
        On the design's centreline.
    across : (n, 2, 3) float64
        Orthonormal directions in the plane.
    radius : (n,) float64, mm
        Designed lumen radius.
    """

    centre: FloatArray
    across: FloatArray
    radius: FloatArray


@dataclass(frozen=True)
class Sections:
    """What was found in n planes.

    Attributes
    ----------
    open : (n,) bool
        Free of gel somewhere within the designed lumen.
    closed_outline : (n,) bool
        At least `LEAST_MET` of the rays met the wall.
    diameter : (n,) float64, mm
        Of the circle of equal area, widened by what the field's own blur took away and by what a
        calibration says of this instrument's walls; 0 where the lumen is closed, NaN without an
        outline.
    median : (n,) float64, mm
        Twice the median distance to the wall over the rays that met it.
    met : (n,) float64
        Share of the rays that met it.
    offset : (n,) float64, mm
        Distance of the outline's centroid from the designed centreline, NaN without an outline.
    shift : (n, 2) float64, mm
        That centroid in the plane's own directions.
    rays : (n, `RAYS`) float64, mm
        From the centroid to the wall at equal angles, blur not undone; NaN where none was met.
    ovality : (n,) float64
        Longest over shortest axis of the ellipse of the same second harmonic, at least 1.
    noise : (n,) float64, mm
        Standard error of the diameter, by the scatter of the rays about a smooth outline. Of a
        short vessel's sections without one, that of the median (`partial_noise`).
    """

    open: BoolArray
    closed_outline: BoolArray
    diameter: FloatArray
    median: FloatArray
    met: FloatArray
    offset: FloatArray
    shift: FloatArray
    rays: FloatArray
    ovality: FloatArray
    noise: FloatArray

    @property
    def area(self) -> FloatArray:
        """Of the lumen, (n,), mm²; 0 where closed, NaN without an outline."""
        return np.asarray(np.pi / 4 * self.diameter**2)


def oval_conductance(ovality: FloatArray) -> FloatArray:
    """Return the conductance of an oval over that of a circle of its area, (n,); 1 where unknown.

    2 / (o + 1/o) with the ovality o (Poiseuille flow in an ellipse, White, Viscous Fluid Flow,
    3-3.3).
    """
    return np.where(np.isfinite(ovality), 2 / (ovality + 1 / ovality), 1.0)


def cut_sections(field: GelField, planes: Planes) -> Sections:
    """Measure the lumen in each plane by rays from its middle to the wall."""
    angle = 2 * np.pi * np.arange(RAYS) / RAYS
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    start, is_open = _free_start(field, planes, circle)
    shift = start
    for _ in range(3):
        radii = wall_distances(field, planes, shift, circle)
        centroid = _centroid(_fill_gaps(radii), circle)
        shift = np.where(np.isfinite(centroid), shift + centroid, shift)
    rays = wall_distances(field, planes, shift, circle)
    met = np.isfinite(rays).mean(axis=1)
    radii = _fill_gaps(rays)
    area = np.pi * (radii**2).mean(axis=1)  # sectors, not triangles: the wall is round
    outline = is_open & (met >= LEAST_MET)
    round_ = true_diameter(2 * np.sqrt(area / np.pi), field, planes)
    diameter = np.where(outline, round_, np.where(is_open, np.nan, 0.0))
    offset = np.where(outline, np.linalg.norm(shift, axis=1), np.nan)
    own = np.where((met > 0)[:, None], rays, np.inf)  # those of other lumens would move it
    middle = np.where(met > 0, np.nanmedian(own, axis=1), np.nan)
    median = true_diameter(2 * middle, field, planes)
    oval, noise = _shape(radii, field.blur_mm)
    return Sections(
        open=is_open,
        closed_outline=outline,
        diameter=diameter,
        median=median,
        met=met,
        offset=offset,
        shift=shift,
        rays=rays,
        ovality=np.where(outline, oval, np.nan),
        noise=np.where(outline, noise, np.nan),
    )


def _shape(radii: FloatArray, blur: float) -> tuple[FloatArray, FloatArray]:
    """Ovality, and the diameter's standard error, of outlines (n, `RAYS`).

    With r(φ) = r₀ + r₂ cos 2(φ - φ₂) the axes are 2 (r₀ ± r₂). What harmonics above the second
    leave is noise or roughness; it is as correlated along the wall as the field is blurred: a
    Gaussian of σ has the correlation length 2 √π σ, so that 2 π r₀ / (2 √π σ) rays are independent.
    """
    spectrum = np.fft.rfft(radii, axis=1) / radii.shape[1]
    mean = np.maximum(spectrum[:, 0].real, 1e-9)
    second = np.minimum(2 * np.abs(spectrum[:, 2]), 0.9 * mean)
    rest = np.sqrt(2 * (np.abs(spectrum[:, 3:]) ** 2).sum(axis=1))
    independent = independent_rays(mean, blur)
    # Harmonics 0 to 2 have taken five degrees of freedom.
    error = rest / np.sqrt(independent - 5.0)
    return (mean + second) / (mean - second), 2 * error


def partial_noise(sections: Sections, blur: float) -> FloatArray:
    """Standard error of the median diameter where half of the rays met the wall, (n,), mm.

    The scatter of the rays that did (median absolute deviation), and by how far the median may lie
    from that of the whole wall: half of all rays are a larger part of those that met the wall. Gel
    thinner than the blur, for which the others met none, moves the wall beside it (`_THIN_GEL`),
    the more where rays don't agree (`_AGREE`). NaN where under half did.
    """
    enough = sections.met > 0.5
    rays = np.where(enough[:, None], sections.rays, 1.0)
    middle = np.nanmedian(rays, axis=1)
    scatter = _MAD * np.nanmedian(np.abs(rays - middle[:, None]), axis=1)
    met = np.where(enough, sections.met, 1.0)
    random = np.sqrt(np.pi / 2 / (met * independent_rays(middle, blur)))
    high = ndtri(np.minimum(0.5 / met, _HIGHEST))
    thin = _THIN_GEL * blur * np.maximum(scatter / (_AGREE * middle), 1.0) ** 2
    noise = np.hypot(2 * scatter * np.hypot(random, high), thin)
    return np.asarray(np.where(enough, noise, np.nan))


def independent_rays(radius: FloatArray, blur: float) -> FloatArray:
    """Number of rays that err independently under a blur (`_shape`)."""
    return np.asarray(np.clip(np.sqrt(np.pi) * radius / max(blur, 1e-9), 6.0, RAYS))


def true_diameter(diameter: FloatArray, field: GelField, planes: Planes) -> FloatArray:
    """Return diameters (n,) without the field's blur, with walls where this instrument's truly are.

    A wall's part w n² along the light, averaged round a section, widens it by w times the square
    of the beam's part in its plane.
    """
    walls = 2 * field.wall_mm + field.facing_mm * (planes.across[..., 2] ** 2).sum(axis=1)
    return np.asarray(np.maximum(_unblurred(diameter, field.blur_mm) + walls, 0.0))


def _unblurred(diameter: FloatArray, blur: float) -> FloatArray:
    """Diameter before a blur of standard deviation σ moved the wall inwards by σ²/(2 r).

    The half level's shift on a cylinder to first order (the curvature term of the diffusion
    equation). With r as measured it is within 0.4 % of r of the exact one (a disc's part of a
    bivariate normal, a non-central χ²) up to σ = 0.5 r; held to a fifth of the radius.
    """
    radius = np.maximum(diameter / 2, 1e-9)
    return np.asarray(diameter + 2 * np.minimum(blur**2 / (2 * radius), 0.2 * radius))


def _positions(planes: Planes, flat: FloatArray) -> FloatArray:
    """Scan positions (n, ..., 3) of in-plane positions (n, ..., 2)."""
    n = len(planes.centre)
    shape = (n,) + (1,) * (flat.ndim - 2) + (3,)
    return np.asarray(
        planes.centre.reshape(shape)
        + flat[..., 0:1] * planes.across[:, 0].reshape(shape)
        + flat[..., 1:2] * planes.across[:, 1].reshape(shape)
    )


def _free_start(
    field: GelField, planes: Planes, circle: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """A place in each plane that is free of gel, (n, 2), and whether there is one.

    The middle if it is free; else the freest place within the designed lumen.
    """
    rings = np.linspace(0.15, 0.95, 7)
    pattern = np.concatenate(
        [np.zeros((1, 2)), (rings[:, None, None] * circle[::3]).reshape(-1, 2)]
    )
    flat = planes.radius[:, None, None] * pattern
    value = field.above_level(_positions(planes, flat))
    value = np.where(np.isnan(value), np.inf, value)
    best = np.where(value[:, 0] < 0, 0, value.argmin(axis=1))
    rows = np.arange(len(flat))
    return flat[rows, best], np.asarray(value[rows, best] < 0)


def wall_distances(
    field: GelField, planes: Planes, shift: FloatArray, circle: FloatArray
) -> FloatArray:
    """Return the way from the shifted middle to the wall on each ray, (n, rays), NaN if not met."""
    step = 0.3 * float(field.voxel_mm.min())
    reach = REACH * float(planes.radius.max()) + 3 * step
    along = np.arange(0.0, reach, step)
    grid = (field.values, field.sign, field.level, field.origin_mm, field.voxel_mm)
    radius = first_walls(*grid, planes.centre, planes.across, shift, circle, along, step)
    near = radius <= REACH * planes.radius[:, None] + 2 * step
    return np.where(near, radius, np.nan)


def _fill_gaps(radii: FloatArray) -> FloatArray:
    """Rays that met no wall take the mean of their section's."""
    met = np.isfinite(radii)
    count = np.maximum(met.sum(axis=1), 1)
    mean = np.where(met, radii, 0.0).sum(axis=1) / count
    mean = np.where(met.any(axis=1), mean, np.nan)
    return np.where(met, radii, mean[:, None])


def _centroid(radii: FloatArray, circle: FloatArray) -> FloatArray:
    """Centroid of the outline, relative to where the rays start, (n, 2)."""
    corner = radii[..., None] * circle
    ahead = np.roll(corner, -1, axis=1)
    twice = corner[..., 0] * ahead[..., 1] - corner[..., 1] * ahead[..., 0]
    moment = ((corner + ahead) * twice[..., None]).sum(axis=1) / 3.0
    return np.asarray(moment / np.maximum(twice.sum(axis=1), 1e-12)[:, None])
