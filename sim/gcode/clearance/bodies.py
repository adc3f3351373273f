"""Input arrays of the shaft check kernels: written ink, moving tips, vessel joints."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kernels.arrays import FloatArray, IntArray
from sim.errors import ClearanceError

LEFT, NEXT = 0, 1
"""Roles of a vessel for a piece of motion: written or left, and gone to."""


class Ink(NamedTuple):
    """Written pieces in the order of time, each a filament with a straight axis.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
    radius : (n, 2) float64, mm
        At both.
    when : (n,) int64
        Piece of motion that wrote it.
    run : (n,) int64
        Pass that it is of.
    vessel : (n,) int64
        -1 for none.
    arc : (n, 2) float64, mm
        Path written in its pass before each end.
    along : (n, 2) float64, mm
        Of each end, along its vessel.
    """

    start: FloatArray
    end: FloatArray
    radius: FloatArray
    when: IntArray
    run: IntArray
    vessel: IntArray
    arc: FloatArray
    along: FloatArray


class Tips(NamedTuple):
    """Pieces of motion of every needle's tip.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
    move : (n,) int64
        Which move each is of; those of one move stand together.
    when : (n,) int64
        Order in time.
    needle : (n,) int64
    run : (n,) int64
        Pass that it writes, or that this needle has written last; -1 for none.
    arc : (n, 2) float64, mm
        Path in that pass, and since its end, before each end.
    vessel : (n, 2) int64
        By role: written or left, and gone to; -1 for none.
    radius : (n, 2) float64, mm
        Of the filament, by role.
    along : (n, 2, 2) float64, mm
        By role, at each end: the place along that vessel.
    since : (n, 2, 2) float64, mm
        By role, at each end: way from the pass's end, or to the next one's start; 0 in a pass.
    """

    start: FloatArray
    end: FloatArray
    move: IntArray
    when: IntArray
    needle: IntArray
    run: IntArray
    arc: FloatArray
    vessel: IntArray
    radius: FloatArray
    along: FloatArray
    since: FloatArray


class Joints(NamedTuple):
    """Where vessels meet, those of vessel ``v`` in ``begin[v] : begin[v + 1]``.

    Attributes
    ----------
    begin : (v + 1,) int64
    other : (m,) int64
        The vessel met, ascending for each vessel; the same one where it meets itself.
    own, there : (m,) float64, mm
        Way along the vessel, ascending for each other, and along that one.
    wide : (m,) float64, mm
        How far the place itself reaches to either side: 0 for a node.
    gap : (m,) float64, mm
        Between the two axes: 0 for a node.
    radius_mm : float, mm
        The thinnest needle's at its tip, without its clearance.
    overlap_radii : float
    lumen_mm : (v,) float64, mm
        Radius of a lumen that is written as several strands: joints reach by it. 0 for others.
    length_mm : (v,) float64, mm
    """

    begin: IntArray
    other: IntArray
    own: FloatArray
    there: FloatArray
    wide: FloatArray
    gap: FloatArray
    radius_mm: float
    overlap_radii: float
    lumen_mm: FloatArray
    length_mm: FloatArray


# Needle shape for the shaft check: upright shaft, tip cone and hub around the tip's axis.


@dataclass(frozen=True)
class NeedleBody:
    """A vertical needle, a body of revolution about the line above its tip.

    Attributes
    ----------
    radius_mm : float, mm
        Outer radius of the shaft.
    tip_radius_mm : float or None, mm
        Outer radius at the tip, at most the shaft's; None for a blunt tube.
    cone_mm : float, mm
        Height over which the one grows to the other; 0 for a blunt tube.
    length_mm : float, mm
        From the tip to the hub; inf where nobody knows it.
    hub_radius_mm : float or None, mm
        Of the hub above the shaft; None where nobody knows it: the shaft then goes on.
    clearance_mm : float, mm
        To be kept between the shaft and what is written. Nearer is told, touching is a crossing.

    Raises
    ------
    ClearanceError
        For lengths that are none, or a tip wider than the shaft.
    """

    radius_mm: float
    tip_radius_mm: float | None = None
    cone_mm: float = 0.0
    length_mm: float = math.inf
    hub_radius_mm: float | None = None
    clearance_mm: float = 0.0

    def __post_init__(self) -> None:
        for name in ("radius_mm", "length_mm"):
            if not getattr(self, name) > 0:
                raise ClearanceError(f"needle: {name} is {getattr(self, name):g}; give more than 0")
        for name in ("cone_mm", "clearance_mm"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ClearanceError(f"needle: {name} is {getattr(self, name):g}; give 0 or more")
        tip = self.tip_radius_mm
        if tip is not None and not 0 <= tip <= self.radius_mm:
            raise ClearanceError(
                f"needle: tip_radius_mm {tip:g} isn't between 0 and the shaft's {self.radius_mm:g}"
            )
        if self.hub_radius_mm is not None and not self.hub_radius_mm >= self.radius_mm:
            raise ClearanceError(
                f"needle: hub_radius_mm {self.hub_radius_mm:g} is below the shaft's "
                f"{self.radius_mm:g}"
            )

    @property
    def tip_mm(self) -> float:
        """Outer radius at the tip, mm."""
        return self.radius_mm if self.tip_radius_mm is None else self.tip_radius_mm

    @property
    def widest_mm(self) -> float:
        """Largest radius anywhere, mm."""
        return self.radius_mm if self.hub_radius_mm is None else self.hub_radius_mm

    def as_row(self) -> FloatArray:
        """For `clearance.kernels.shaft_distance`: radius, tip, cone, length, hub."""
        tip, cone = self.tip_radius_mm, self.cone_mm
        if tip is None or cone == 0:
            tip, cone = self.radius_mm, 0.0
        length, hub = self.length_mm, self.hub_radius_mm
        if hub is None:
            length, hub = math.inf, self.radius_mm
        return np.array([self.radius_mm, tip, cone, length, hub], dtype=np.float64)
