"""Find walls too thin for any line, and gaps that lines beside them may close."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from manifold3d import CrossSection

from design.toolpath.fresh.contours import Contours, contours_of, sample
from design.toolpath.fresh.largest_disc import measure_room
from design.toolpath.toolpath import FloatArray

#: Sides face each other when the product of their normals is below this: corners aren't narrow.
FACING = -0.7
#: A narrow place is so many of the least widths long, or a tip of something broader,
SHORTEST = 4.0
#: or so much of a whole ring: a hole, a pin.
WHOLE = 0.7


@dataclass(frozen=True)
class NarrowPlaces:
    """Places that are narrower than lines can make.

    Attributes
    ----------
    least_mm : float, mm
        Least width that lines make.
    width_mm : float, mm
        Median of what the places have.
    at_mm : (x, y, z), mm
        One of that width, in the part's frame.
    layers : float
        Part of the layers looked at that have such places.
    """

    least_mm: float
    width_mm: float
    at_mm: tuple[float, float, float]
    layers: float


def narrow_samples(section: CrossSection, least_mm: float, *, gaps: bool) -> FloatArray:
    """Places along a section's contours where it, or a gap in it, is narrower than ``least_mm``.

    Returns
    -------
    (n, 3) float64, mm
        Width, x, y.
    """
    contours = contours_of(section)
    if gaps:
        last = contours.offset[-1]
        contours = Contours(contours.points[::-1], last - contours.offset[::-1])
    if not len(contours):
        return np.empty((0, 3))
    fine = sample(contours, 0.5 * least_mm)
    room, other = measure_room(fine, 0.5 * least_mm)
    points, after = fine.contours.points, fine.contours.next
    way = points[after] - points
    length = np.hypot(*way.T)
    normal = np.column_stack([-way[:, 1], way[:, 0]]) / np.maximum(length, 1e-12)[:, None]
    near = (other >= 0) & (room < 0.5 * least_mm * (1 - 1e-3))
    narrow = near & ((fine.normal * normal[other]).sum(axis=1) < FACING)
    ring = fine.contours.ring
    whole = np.bincount(ring, near) > WHOLE * np.bincount(ring)
    run = np.cumsum(~narrow | (np.diff(ring, prepend=-1) > 0))
    long = np.bincount(run[narrow], length[narrow], minlength=run[-1] + 1) >= SHORTEST * least_mm
    narrow = (narrow & long[run]) | (near & whole[ring])
    middle = points[narrow] + room[narrow, None] * fine.normal[narrow]
    return np.column_stack([2 * room[narrow], middle])


def narrow_places(
    samples: Sequence[FloatArray], z_mm: Sequence[float], least_mm: float
) -> NarrowPlaces | None:
    """Sum up what `narrow_samples` found in layers at the heights ``z_mm``; None for nothing."""
    heights = np.repeat(np.asarray(z_mm), [len(one) for one in samples])
    if not len(heights):
        return None
    rows = np.column_stack([np.concatenate(samples), heights])
    width, *at = rows[np.argsort(rows[:, 0], kind="stable")[(len(rows) - 1) // 2]].tolist()
    share = float(np.mean([len(one) > 0 for one in samples]))
    return NarrowPlaces(least_mm, width, (at[0], at[1], at[2]), share)
