"""Designed voids that must stay open: depth of ink in them, those near a mend."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from printctl.observe.mending.held_print import HeldPrint, MendError, written_paths
from printctl.observe.mending.laid_ink import laid_ink, nearest_pieces

_AROUND = 16
"""Places on the rim of a line that are looked at."""


@dataclass(frozen=True, eq=False)
class Voids:
    """Straight, tapered tubes without ink, in the printer's frame.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
    radius : (n, 2) float64, mm
        At both ends.

    Raises
    ------
    MendError
        When the arrays don't belong together.
    """

    start: FloatArray
    end: FloatArray
    radius: FloatArray

    def __post_init__(self) -> None:
        count = len(self.start)
        if self.start.shape != (count, 3) or self.end.shape != (count, 3):
            raise MendError("voids: start and end are (n, 3), mm")
        if self.radius.shape != (count, 2) or not (np.isfinite(self.radius).all()):
            raise MendError("voids: radius is (n, 2), mm, at both ends")

    @staticmethod
    def none() -> Voids:
        """No void."""
        return Voids(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2)))

    @staticmethod
    def of_network(network: VesselNetwork, place_mm: ArrayLike) -> Voids:
        """Return a network's lumens, moved by ``place_mm`` from the part's frame."""
        inner = np.ones(len(network.points) - 1, dtype=bool)
        inner[network.offset[1:-1] - 1] = False
        begin = np.flatnonzero(inner)
        points = network.points + np.asarray(place_mm, dtype=np.float64)
        radius = np.column_stack([network.radius[begin], network.radius[begin + 1]])
        return Voids(points[begin], points[begin + 1], radius)

    def __len__(self) -> int:
        return len(self.start)

    def near(self, low: FloatArray, high: FloatArray) -> Voids:
        """Those that reach into a box, corners (3,) mm."""
        wide = self.radius.max(axis=1, initial=0.0)[:, None]
        below = np.minimum(self.start, self.end) - wide <= high
        above = np.maximum(self.start, self.end) + wide >= low
        return self.where((below & above).all(axis=1))

    def where(self, rows: NDArray[np.bool_]) -> Voids:
        """Those of a mask."""
        return Voids(self.start[rows], self.end[rows], self.radius[rows])

    def depth_mm(self, places: FloatArray) -> FloatArray:
        """How deep places (m, 3) lie in the nearest void, (m,), mm; below 0 outside.

        Of a tapered tube the radius beside the place's foot on the axis counts: exact for
        straight tubes, to (Δr / length)² / 2 of the radius for others.
        """
        depth = np.full(len(places), -np.inf)
        for a, b, (r0, r1) in zip(self.start, self.end, self.radius, strict=True):
            step = b - a
            square = float(step @ step)
            share = np.zeros(len(places))
            if square > 0:
                share = np.clip((places - a) @ step / square, 0.0, 1.0)
            away = np.linalg.norm(a + share[:, None] * step - places, axis=1)
            np.maximum(depth, r0 + share * (r1 - r0) - away, out=depth)
        return depth


def ink_in_voids_mm(
    voids: Voids,
    places: FloatArray,
    width_mm: FloatArray,
    height_mm: FloatArray,
    *,
    layered: bool,
) -> FloatArray:
    """How deep ink around tip places reaches into a void, (m,), mm; below 0 for none.

    A line of a layer is looked at in the middle of its height, where the design's layers are cut
    (`design.toolpath.fresh.section`), as a disc of its width; a filament as a ball.

    Parameters
    ----------
    voids : Voids
    places : (m, 3) float64, mm
        Of the tip.
    width_mm, height_mm : (m,) float64, mm
    layered : bool
    """
    reach = width_mm.max(initial=0.0) / 2 + height_mm.max(initial=0.0)
    if not len(places):
        return np.zeros(0)
    close = voids.near(places.min(axis=0) - reach, places.max(axis=0) + reach)
    if not layered:
        return close.depth_mm(places) + width_mm / 2
    middle = places - np.array([0.0, 0.0, 0.5]) * height_mm[:, None]
    deepest = close.depth_mm(middle)
    for angle in np.linspace(0.0, 2 * np.pi, _AROUND, endpoint=False):
        side = np.array([np.cos(angle), np.sin(angle), 0.0])
        np.maximum(deepest, close.depth_mm(middle + width_mm[:, None] / 2 * side), out=deepest)
    return deepest


_ON_AXIS: Final = 0.5
"""Share of a void's radius within which a written axis is the void's own."""


def open_voids(voids: Voids, held: HeldPrint, places: FloatArray, reach_mm: float) -> Voids:
    """Return the voids near places (m, 3), mm, that ink must keep out of.

    An embedded print writes sacrificial ink where its lumens are to be, so a network's vessels are
    voids to it only where no path of the job, written or to come, goes along them.
    """
    if held.style == "layered" or not len(voids) or not len(places):
        return voids
    close = voids.near(places.min(axis=0) - reach_mm, places.max(axis=0) + reach_mm)
    planned = laid_ink(written_paths(held, len(held.lines)))
    own = np.ones(len(close), dtype=bool)
    for share in (0.1, 0.5, 0.9):
        axis = close.start + share * (close.end - close.start)
        own &= nearest_pieces(axis, planned)[1] <= _ON_AXIS * close.radius.mean(axis=1)
    return close.where(~own)
