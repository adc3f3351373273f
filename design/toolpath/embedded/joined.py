"""Data classes: how far passes are extended to overlap at joints; joints without full overlap."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from kernels.arrays import FloatArray


@dataclass(frozen=True)
class WeakJoint:
    """Two stretches that meet and can't be made to overlap as asked.

    Attributes
    ----------
    vessel, other : int
        The later and the earlier one.
    place_mm : (x, y, z), mm
    part : float
        Of the overlap that there is room for; 0 where the joint stays open.
    barred_by : int
        Of an open one the vessel whose ink the shaft would meet, or whose shaft would meet the
        overlap; -1 before that is asked.
    needle_mm : float, mm
        Outer diameter of a needle's tip that has room for a quarter of the overlap in this order;
        0 where none has.
    apart_mm : float, mm
        How much further that vessel would have to be from the overlap, sideways.
    """

    vessel: int
    other: int
    place_mm: tuple[float, float, float]
    part: float
    barred_by: int = -1
    needle_mm: float = 0.0
    apart_mm: float = 0.0


class BrushedOverlap(NamedTuple):
    """An overlap that the shaft meets while a later element is written, or ink met from one.

    Attributes
    ----------
    element : int
        The later one, or that which the overlap goes on from.
    end : int
        The earlier one: that which the overlap goes on from, or ink.
    entered : bool
        Whether the needle itself meets it, or its clearance only.
    """

    element: int
    end: int
    entered: bool


@dataclass
class JoinedPasses:
    """Embedded passes extended to overlap at their joints.

    Attributes
    ----------
    before, beyond : (p,) float64, mm
        How far each pass begins before its first point, and goes on beyond its last.
    joints, overlapped : int
        Ends that come to ink; of these, those closed by an overlap.
    through : int
        Stretches that go on from the last one through a node without a stop.
    open : list of WeakJoint
        Those without an overlap.
    shortened : list of WeakJoint
        Of the overlapped, those with less than asked.
    brushed : list of BrushedOverlap
    reorderings : list of (int, int)
        Elements of which the first, written before the second, would leave room for an overlap.
    """

    before: FloatArray
    beyond: FloatArray
    joints: int = 0
    overlapped: int = 0
    through: int = 0
    open: list[WeakJoint] = field(default_factory=list)
    shortened: list[WeakJoint] = field(default_factory=list)
    brushed: list[BrushedOverlap] = field(default_factory=list)
    reorderings: list[tuple[int, int]] = field(default_factory=list)
