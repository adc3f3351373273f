"""Estimate a print's size over its design's along each axis, from lumen axes or its surface.

A scale that is fitted to the surface takes walls that moved (lines that spread, a scanner's bias)
for size: 20 um on either face of 8 mm are half a percent. A lumen's axis stays where it is when its
walls move alike, so the way from one lumen to another tells shrinkage by itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from printctl.corrections.feedback.evidence import Print
from printctl.corrections.feedback.readings import Reading
from printctl.corrections.feedback.whole_part import BIAS_VOXELS, NORMAL_95

OFFSET_VOXELS = 0.1
"""Standard deviation of a lumen's place that repeats in every scan: one wall is lit otherwise than
the one opposite (`registration.alignment.intervals`), by 2 to 5 um at 25 um."""
GOOD_ENOUGH = 0.003
"""Half width of the interval up to which lumens decide."""
_SHIFT_PRIOR_MM, _SIZE_PRIOR = 0.1, 0.05

UNKNOWN = 0.1
"""Half width for a scale whose interval was withdrawn: what is off by more is refused."""


@dataclass(frozen=True)
class Size:
    """One print's size over the design's.

    Attributes
    ----------
    scale, half : (3,) float64
        Along x, y, z, and half widths of the 95 % intervals.
    by_lumens : (3,) bool
        Whether the lumens' places told it; else the surface did.
    shift_mm : (3,) float64, mm
        Of all lumens together against the surface.
    growth : (3,) float64
        What the lumens' places add to the registration's scale.
    """

    scale: FloatArray
    half: FloatArray
    by_lumens: NDArray[np.bool_]
    shift_mm: FloatArray
    growth: FloatArray

    def explains(self, places: FloatArray, about: FloatArray) -> FloatArray:
        """Offset from where registration put the axes, of places (n, 3), mm."""
        return np.asarray(self.shift_mm + self.growth * (places - about))


def size_of(
    print_: Print, per_vessel: dict[int, Reading], about: FloatArray, voxel_mm: float
) -> Size:
    """A print's size.

    Parameters
    ----------
    print_ : Print
    per_vessel : dict of Reading
    about : (3,) float64, mm
        The part's middle.
    voxel_mm : float, mm
    """
    scale = np.array(print_.facts.scale)
    surface = _surface_half(print_)
    low, high = np.array(print_.design.bounds_mm)
    if "budget" not in print_.found:
        surface = np.hypot(surface, BIAS_VOXELS * voxel_mm / ((high - low) / 2))
    best, error = _fit(print_.network, per_vessel, about, voxel_mm)
    half = NORMAL_95 * error[3:]
    by_lumens = half < GOOD_ENOUGH
    growth = np.where(by_lumens, best[3:], 0.0)
    return Size(
        scale=scale * (1 + growth),
        half=np.where(by_lumens, half, surface),
        by_lumens=by_lumens,
        shift_mm=best[:3],
        growth=growth,
    )


def _surface_half(print_: Print) -> FloatArray:
    """Half widths of the fitted scales' intervals, (3,).

    A scale that was fitted without an interval isn't known; one that wasn't fitted is 1 by decree.
    """
    return np.array([
        half if half is not None else 0.0 if scale == 1.0 else UNKNOWN
        for scale, half in zip(print_.facts.scale, print_.facts.scale_interval_95, strict=True)
    ])  # fmt: skip


def without_size(reading: Reading, print_: Print, size: Size, about: FloatArray) -> Reading:
    """A reading without what the print's size explains of its axis' offset."""
    if reading.ends_mm is None:
        return reading
    nodes = print_.network.nodes[print_.network.vessel_nodes[reading.vessel]]
    return replace(reading, ends_mm=reading.ends_mm - size.explains(nodes, about))


def projector_across(network: VesselNetwork, vessel: int, end: int) -> FloatArray:
    """Projector (3, 3) onto the plane across a vessel's first (0) or last (1) end."""
    points, _ = network.polyline(vessel)
    way = points[1] - points[0] if end == 0 else points[-1] - points[-2]
    way = way / np.linalg.norm(way)
    return np.asarray(np.eye(3) - np.outer(way, way))


def _fit(
    network: VesselNetwork, per_vessel: dict[int, Reading], about: FloatArray, voxel_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Shift and growth (6,) that explain the vessels' offsets best, and standard errors.

    What single lumens are off beside that widens the errors (method of moments).
    """
    rows, values, errors = [], [], []
    for vessel, reading in per_vessel.items():
        if reading.ends_mm is None:
            continue
        for end in (0, 1):
            plane = projector_across(network, vessel, end)
            place = network.nodes[network.vessel_nodes[vessel, end]] - about
            rows.append(plane @ np.hstack([np.eye(3), np.diag(place)]))
            values.append(plane @ reading.ends_mm[end])
            errors.append(float(reading.ends_error_mm[end]))
    prior = np.diag(1 / np.array([_SHIFT_PRIOR_MM] * 3 + [_SIZE_PRIOR] * 3) ** 2)
    if not rows:
        return np.zeros(6), np.sqrt(1 / np.diag(prior))
    columns, offset = np.concatenate(rows), np.concatenate(values)
    own = np.repeat(np.array(errors) ** 2 + (OFFSET_VOXELS * voxel_mm) ** 2, 3)
    free = max(2 * len(rows) - 6, 1)  # a plane has two directions
    extra = 0.0
    for _ in range(30):
        weight = 1 / (own + extra)
        normal = columns.T @ (weight[:, None] * columns) + prior
        best = np.linalg.solve(normal, columns.T @ (weight * offset))
        excess = float((weight * (offset - columns @ best) ** 2).sum()) / free - 1
        extra = max(0.0, extra + excess / float(weight.mean()))
    return best, np.sqrt(np.diag(np.linalg.inv(normal)))
