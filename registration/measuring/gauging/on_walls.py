"""Scanned points on the walls of a vessel's sections, and the sections' outlines there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from kernels.arrays import FloatArray
from registration.measuring.gauging.sections import RAYS, Planes, Sections

LEAST_MM = 0.1
"""A wall is looked for within half a radius of the design's, and at least this."""
CLASS = 1.25
"""Radii of stations within which the nearest axis is that of the nearest wall."""


def near_walls(
    centre: FloatArray, radius: FloatArray, points: FloatArray
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the station whose lumen each point is deepest in, and whether the point is its wall.

    Where lumens meet, the design's wall is that of the lumen which reaches farther: beside a thin
    vessel's mouth in a wide one the wall is the wide one's, though the thin one's axis is nearer.

    Parameters
    ----------
    centre, radius : (s, 3), (s,) float64, mm
        Stations on vessels' axes.
    points : (n, 3) float64, mm

    Returns
    -------
    which : (n,) int64
        Some station where none is so near that the point could be a wall.
    wall : (n,) bool
    """
    reach = np.maximum(0.5 * radius, LEAST_MM)
    # Most of a part's surface is far from any vessel: nobody asks how far.
    farthest = float((radius + reach).max()) * (1 + 1e-9)
    away, which = cKDTree(centre).query(points, workers=1, distance_upper_bound=farthest)
    close = np.flatnonzero(np.isfinite(away))
    which = np.where(np.isfinite(away), which, 0).astype(np.int64)
    outside = away - radius[which]
    for members in _classes(radius):
        bound = float((radius + reach)[members].max()) * (1 + 1e-9)
        tree = cKDTree(centre[members])
        far, nearest = tree.query(points[close], workers=1, distance_upper_bound=bound)
        chosen = members[np.minimum(nearest, len(members) - 1)]
        deeper = far - radius[chosen] < outside[close]
        outside[close[deeper]] = (far - radius[chosen])[deeper]
        which[close[deeper]] = chosen[deeper]
    return which, np.abs(outside) < reach[which]


def _classes(radius: FloatArray) -> list[NDArray[np.int64]]:
    """Stations of about one radius together; none where all are alike."""
    step = np.floor(np.log(radius / radius.min()) / np.log(CLASS)).astype(np.int64)
    classes = [np.flatnonzero(step == one) for one in np.unique(step)]
    return classes if len(classes) > 1 else []


@dataclass(frozen=True)
class Outlines:
    """Where n sections were cut, and the wall found there.

    Attributes
    ----------
    planes : Planes
        The cuts, in the scan's frame.
    wall : (n, `RAYS`, 2) float64, mm
        The wall from the designed axis, in each plane's own directions. Its circle of equal area
        has the section's diameter: blur and walls' corrections are added all round. NaN where no
        wall was met, and all round where the lumen is closed.
    middle : (n, 2) float64, mm
        Centroid of the wall as it was met, in the same directions.
    """

    planes: Planes
    wall: FloatArray
    middle: FloatArray


def outlines(
    planes: Planes, sections: Sections, diameter: FloatArray, chosen: NDArray[np.bool_]
) -> Outlines:
    """Return the outlines of some sections.

    Parameters
    ----------
    planes : Planes
        n of them.
    sections : Sections
        What was found in them.
    diameter : (n,) float64, mm
        As reported; 0 where closed.
    chosen : (n,) bool
    """
    rays, shift = sections.rays[chosen], sections.shift[chosen]
    met = np.isfinite(rays)
    squares = np.where(met, rays, 0.0) ** 2
    drawn = np.sqrt(squares.sum(axis=1) / np.maximum(met.sum(axis=1), 1))
    reported = np.where(diameter[chosen] > 0, diameter[chosen] / 2, np.nan)
    angle = 2 * np.pi * np.arange(RAYS) / RAYS
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    wall = shift[:, None] + (rays + (reported - drawn)[:, None])[..., None] * circle
    cut = replace(
        planes,
        centre=planes.centre[chosen],
        across=planes.across[chosen],
        radius=planes.radius[chosen],
    )
    return Outlines(cut, wall, shift)
