"""Pictures of the raw scan across each vessel at measured sections, with the found contours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.json_ready import Record
from registration.overlay.cut import Shades, trilinear
from registration.scan import Scan

if TYPE_CHECKING:
    from registration.measuring.gauging import VesselGauge


MOST_SECTIONS = 1200
"""With a picture: 2 to 3 MB of a page. Beyond it sections that pass are thinned evenly."""
PIXELS = 56
REACH = 2.2
"""Half a picture's edge over the designed radius: rays to the wall go out to 2."""


@dataclass(frozen=True)
class SectionStack:
    """Pictures of n sections, looked at along the vessel; light comes from above.

    Attributes
    ----------
    vessel : (n,) int64
    index : (n,) int64
        Place among the vessel's measured sections.
    radius : (n,) float64, mm
        Designed, about the picture's middle: the designed axis as the fit places it.
    half : (n,) float64, mm
        Half of a picture's edge.
    grey : (n, `PIXELS`, `PIXELS`) uint8
        The scan's own values, interpolated linearly, nothing filtered; rows downwards.
    wall : (n, rays, 2) float64, mm
        Measured contour from the middle: to the right, and down. NaN where there is none.
    total : int
        Sections measured; n of them have a picture.
    """

    vessel: NDArray[np.int64]
    index: NDArray[np.int64]
    radius: FloatArray
    half: FloatArray
    grey: NDArray[np.uint8]
    wall: FloatArray
    total: int

    def find(self, vessel: int, index: int) -> int | None:
        """Return the picture of a vessel's section; None where it has none."""
        rows = np.flatnonzero((self.vessel == vessel) & (self.index == index))
        return int(rows[0]) if len(rows) else None


def chosen_sections(
    decisions: Sequence[Sequence[str]], most: int = MOST_SECTIONS
) -> list[NDArray[np.int64]]:
    """Choose the sections of each vessel that get a picture.

    All where there are at most `most`; else those that aren't a pass, and of the others every
    k-th along each vessel.

    Parameters
    ----------
    decisions : sequence of sequences of str
        Of each vessel's sections.
    most : int
    """
    total = sum(map(len, decisions))
    step = 1
    while True:
        chosen = [
            np.array([k for k, d in enumerate(row) if d != "pass" or k % step == 0], np.int64)
            for row in decisions
        ]
        if sum(map(len, chosen)) <= most or step > total:
            return chosen
        step += 1


def section_stack(
    scan: Scan, shades: Shades, vessels: Sequence[VesselGauge], rows: Sequence[Record]
) -> SectionStack:
    """Take the pictures of a registration's sections.

    Parameters
    ----------
    scan : Scan
    shades : Shades
    vessels : sequence of VesselGauge
    rows : sequence of dict
        The same vessels as judged, with ``decision_along``.
    """
    chosen = chosen_sections([row["decision_along"] for row in rows])
    parts = [_of_vessel(scan, shades, v, k) for v, k in zip(vessels, chosen, strict=True)]
    number = [np.full(len(k), v.vessel) for v, k in zip(vessels, chosen, strict=True)]
    radius, half, grey, wall = (np.concatenate(each) for each in zip(*parts, strict=True))
    return SectionStack(
        np.concatenate(number).astype(np.int64),
        np.concatenate(chosen),
        radius,
        half,
        grey,
        wall,
        sum(len(vessel.along_mm) for vessel in vessels),
    )


def _of_vessel(
    scan: Scan, shades: Shades, vessel: VesselGauge, chosen: NDArray[np.int64]
) -> tuple[FloatArray, FloatArray, NDArray[np.uint8], FloatArray]:
    """Radius, half edge, pictures and walls of a vessel's chosen sections."""
    planes = vessel.outlines.planes
    centre, across = planes.centre[chosen], _upright(planes.across[chosen], scan.depth_down)
    radius = planes.radius[chosen]
    half = REACH * radius
    side = (np.arange(PIXELS) + 0.5) / PIXELS * 2 - 1
    right, down = np.meshgrid(side, side)
    flat = half[:, None, None, None] * np.stack([right, down], axis=-1)
    points = centre[:, None, None] + np.einsum("nyxk,nkj->nyxj", flat, across)
    turn = np.einsum("nkj,nlj->nkl", planes.across[chosen], across)
    wall = np.einsum("nrk,nkl->nrl", vessel.outlines.wall[chosen], turn)
    return radius, half, shades.grey(trilinear(scan, points)), wall


def _upright(across: FloatArray, depth_down: bool) -> FloatArray:
    """In-plane directions (n, 2, 3) whose second runs away from the light as far as it can."""
    away = across[:, 1, 2] * (1.0 if depth_down else -1.0)
    return np.where((away < 0)[:, None, None], -across, across)
