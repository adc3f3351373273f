"""Designed network as plain arrays, for the shaft check: vessels and nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray
from sim.errors import ClearanceError
from sim.gcode.clearance.axis import Axis

_AT_END_MM: Final = 0.01
"""So near to its end a place on a closed vessel may as well lie at the other one."""


@dataclass(frozen=True)
class WrittenNetwork:
    """Vessels and nodes, in the frame of the motion.

    Attributes
    ----------
    nodes : (m, 3) float64, mm
    vessel_nodes : (v, 2) int64
        First and last node of each vessel.
    offset : (v + 1,) int64
        Points of vessel ``i`` are ``offset[i]:offset[i + 1]``.
    points : (p, 3) float64, mm
    radius : (p,) float64, mm
    bundled : (v,) bool or None
        Vessels that are written as several strands around their axes; None for none.

    Raises
    ------
    ClearanceError
        When the arrays don't belong together.
    """

    nodes: FloatArray
    vessel_nodes: IntArray
    offset: IntArray
    points: FloatArray
    radius: FloatArray
    bundled: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        vessels, points = len(self.vessel_nodes), len(self.points)
        sound = (
            self.vessel_nodes.shape == (vessels, 2)
            and self.nodes.shape == (len(self.nodes), 3)
            and self.points.shape == (points, 3)
            and self.radius.shape == (points,)
            and self.offset.shape == (vessels + 1,)
            and (np.diff(self.offset) >= 2).all()
            and (vessels == 0 or int(self.offset[-1]) == points)
            and (self.bundled is None or self.bundled.shape == (vessels,))
            and self.vessel_nodes.min(initial=0) >= 0
            and self.vessel_nodes.max(initial=-1) < len(self.nodes)
        )
        if not sound:
            raise ClearanceError(
                f"a network of {vessels} vessels, {points} points and {len(self.nodes)} nodes "
                "whose arrays don't belong together; make its file anew"
            )

    @property
    def vessel_count(self) -> int:
        """Number of vessels."""
        return len(self.vessel_nodes)

    def moved(self, by_mm: FloatArray) -> WrittenNetwork:
        """The same, elsewhere."""
        return replace(self, nodes=self.nodes + by_mm, points=self.points + by_mm)

    @property
    def lumen_mm(self) -> FloatArray:
        """Widest radius of each bundled vessel, (v,), mm; 0 of one written as one filament."""
        if self.bundled is None or not self.vessel_count:
            return np.zeros(self.vessel_count)
        return np.where(self.bundled, np.maximum.reduceat(self.radius, self.offset[:-1]), 0.0)

    @cached_property
    def arc(self) -> FloatArray:
        """Of each point along its vessel, (p,), mm."""
        step = np.linalg.norm(np.diff(self.points, axis=0, prepend=self.points[:1]), axis=1)
        whole = np.cumsum(step)
        return np.asarray(whole - np.repeat(whole[self.offset[:-1]], np.diff(self.offset)))

    @cached_property
    def _axes(self) -> dict[int, Axis]:
        """Axes as they are asked for."""
        return {}

    @cached_property
    def lengths(self) -> FloatArray:
        """Of each vessel, (v,), mm."""
        return self.arc[self.offset[1:] - 1]

    def spans(
        self, vessel: IntArray, start: FloatArray, end: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Way along their vessels, and radius there, (n, 2) mm, of straight rows' two ends.

        A row that goes on past its vessel's end counts on: below 0, or above the vessel's length.
        Else what lies between its ends, found by their share, would be as far off. Where a vessel
        comes back to its first point a row has the side on which it lies.
        """
        twice, ends = np.concatenate([vessel, vessel]), np.concatenate([start, end])
        both = self.project(twice, ends)
        both = both[0] + self._past_end(twice, ends, both[0]), both[1]
        along, radius = (np.column_stack(np.split(one, 2)) for one in both)
        whole = np.where(vessel >= 0, self.lengths[vessel], 0.0) if len(self.lengths) else 0.0
        for k in (0, 1):
            closing = (whole > 0) & (np.minimum(along[:, k], whole - along[:, k]) < _AT_END_MM)
            other, at = np.where(along[:, k] < whole / 2, whole, 0.0), along[:, 1 - k]
            turned = closing & self._closed[vessel] & (np.abs(along[:, k] - at) > whole / 2)
            along[:, k] = np.where(turned & (at != other), other, along[:, k])
        return along, radius

    def _past_end(self, vessel: IntArray, place: FloatArray, along: FloatArray) -> FloatArray:
        """How far places (n, 3) lie past the end of their vessel that they project on, (n,), mm.

        Below 0 past the first end. Vessel -1 is none.
        """
        past = np.zeros(len(vessel))
        if not self.vessel_count:
            return past
        own = np.where(vessel >= 0, vessel, 0)
        for end, step, here in (
            (self.offset[:-1], 1, along <= 0.0),
            (self.offset[1:] - 1, -1, along >= self.lengths[own]),
        ):
            rows = np.flatnonzero(here & (vessel >= 0))
            at = end[own[rows]]
            out = self.points[at] - self.points[at + step]
            out /= np.linalg.norm(out, axis=1, keepdims=True)
            past[rows] = -step * np.maximum(((place[rows] - self.points[at]) * out).sum(axis=1), 0)
        return past

    @cached_property
    def _closed(self) -> NDArray[np.bool_]:
        """Vessels that end where they begin, (v,); one more for none."""
        return np.append(self.vessel_nodes[:, 0] == self.vessel_nodes[:, 1], False)

    def project(self, vessel: IntArray, place: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest place along a vessel's axis, and the radius there.

        Parameters
        ----------
        vessel : (n,) int64
            -1 for none.
        place : (n, 3) float64, mm

        Returns
        -------
        along : (n,) float64, mm
            From the vessel's first point; 0 for none.
        radius : (n,) float64, mm
            1 for none.
        """
        along, radius = np.zeros(len(vessel)), np.ones(len(vessel))
        order = np.argsort(vessel, kind="stable")
        cuts = np.searchsorted(vessel[order], np.arange(self.vessel_count + 1))
        for v in np.unique(vessel[vessel >= 0]).tolist():
            rows = order[cuts[v] : cuts[v + 1]]
            points = slice(int(self.offset[v]), int(self.offset[v + 1]))
            arc = self.arc[points]
            if v not in self._axes:
                self._axes[v] = Axis.of(self.points[points], arc)
            along[rows] = self._axes[v].nearest(place[rows])
            radius[rows] = np.interp(along[rows], arc, self.radius[points])
        return along, radius

    def place(self, vessel: int, along_mm: float) -> tuple[float, float, float]:
        """Where on the axis of a vessel such a way along it ends, mm."""
        own = slice(int(self.offset[vessel]), int(self.offset[vessel + 1]))
        x, y, z = (
            round(float(np.interp(along_mm, self.arc[own], self.points[own, k])), 3)
            for k in range(3)
        )
        return x, y, z
