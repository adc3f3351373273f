"""Cross-sections of a lumen, measured in the scan along the design's centreline.

The centreline comes from the design, not from a skeleton of the scan: a skeleton wanders, and its
diameters are off by tens of micrometres where sections are off by a few.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from registration.segmentation.volume import GelField

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

RAYS = 48
REACH = 2.0
"""Rays go out to this many designed radii; what isn't met by then is another lumen."""


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
    in_field : (n,) bool
        The designed lumen and its wall lie in the field of view.
    open : (n,) bool
        Free of gel somewhere within the designed lumen.
    closed_outline : (n,) bool
        At least 90 % of the rays met the wall.
    diameter : (n,) float64, mm
        Of the circle of equal area, widened by what the field's own blur took away; 0 where the
        lumen is closed, NaN without an outline.
    median : (n,) float64, mm
        Twice the median distance to the wall over the rays that met it.
    met : (n,) float64
        Share of the rays that met it.
    offset : (n,) float64, mm
        Distance of the outline's centroid from the designed centreline, NaN without an outline.
    """

    in_field: BoolArray
    open: BoolArray
    closed_outline: BoolArray
    diameter: FloatArray
    median: FloatArray
    met: FloatArray
    offset: FloatArray


def cut(field: GelField, planes: Planes) -> Sections:
    """Measure the lumen in each plane by rays from its middle to the wall."""
    angle = 2 * np.pi * np.arange(RAYS) / RAYS
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    start, is_open = _free_start(field, planes, circle)
    shift = start
    for _ in range(3):
        radii = _rays(field, planes, shift, circle)
        centroid = _centroid(_fill_gaps(radii), circle)
        shift = np.where(np.isfinite(centroid), shift + centroid, shift)
    rays = _rays(field, planes, shift, circle)
    met = np.isfinite(rays).mean(axis=1)
    radii = _fill_gaps(rays)
    area = np.pi * (radii**2).mean(axis=1)  # sectors, not triangles: the wall is round
    outline = is_open & (met >= 0.9)
    round_ = _unblurred(2 * np.sqrt(area / np.pi), field.blur_mm)
    diameter = np.where(outline, round_, np.where(is_open, np.nan, 0.0))
    offset = np.where(outline, np.linalg.norm(shift, axis=1), np.nan)
    median = _unblurred(2 * np.median(radii, axis=1), field.blur_mm)
    inside = _in_field(field, planes, circle)
    return Sections(inside, is_open, outline, diameter, median, met, offset)


def _unblurred(diameter: FloatArray, blur: float) -> FloatArray:
    """Diameter before a blur of standard deviation σ moved the wall inwards by σ²/(2 r).

    That is the half level's shift on a cylinder to first order (from the curvature term of the
    diffusion equation); held to a fifth of the radius, beyond which it isn't small.
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


def _rays(field: GelField, planes: Planes, shift: FloatArray, circle: FloatArray) -> FloatArray:
    """Distance from the shifted middle to the wall along each ray, (n, rays), NaN if not met."""
    step = 0.3 * float(field.voxel_mm.min())
    reach = REACH * float(planes.radius.max()) + 3 * step
    along = np.arange(0.0, reach, step)
    flat = shift[:, None, None] + along[:, None, None] * circle
    value = field.above_level(_positions(planes, flat.transpose(0, 2, 1, 3)))
    crossing = (value[..., :-1] < 0) & (value[..., 1:] >= 0)
    first = crossing.argmax(axis=2)
    low = np.take_along_axis(value, first[..., None], axis=2)[..., 0]
    high = np.take_along_axis(value, first[..., None] + 1, axis=2)[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = along[first] + step * low / (low - high)
    near = radius <= REACH * planes.radius[:, None] + 2 * step
    return np.where(crossing.any(axis=2) & near, radius, np.nan)


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


def _in_field(field: GelField, planes: Planes, circle: FloatArray) -> BoolArray:
    """Whether the wall of the designed lumen lies within the volume all round."""
    rim = planes.radius[:, None, None] * 1.2 * circle[::6]
    return np.asarray(np.isfinite(field.above_level(_positions(planes, rim))).all(axis=1))
