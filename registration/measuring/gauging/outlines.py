"""Wall outlines of a vessel's measured sections, scaled to the reported diameter."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.measuring.gauging.sections import RAYS, Planes, Sections


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
