"""Data classes of an embedded plan's report: times, crossings, open joints, omitted vessels."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from kernels.arrays import FloatArray


@dataclass(frozen=True)
class Crossing:
    """A shaft that passes through what is written.

    Attributes
    ----------
    vessel, through : int
        While `vessel` is written, left or gone to, the shaft passes through vessel `through`
        (itself, where a vessel folds over itself).
    length_mm : float, mm
        Of the way on which that happens.
    depth_mm : float, mm
        Deepest: how far the bare shaft reaches into the ink. Below 0 it passes at that distance.
    place_mm : (x, y, z), mm
        The tip, where it begins the deepest of it.
    """

    vessel: int
    through: int
    length_mm: float
    depth_mm: float
    place_mm: tuple[float, float, float]


@dataclass(frozen=True)
class OmittedVessel:
    """Vessel that isn't printed.

    Attributes
    ----------
    vessel : int
    other : int
        The vessel that it bars and that bars it; itself, where it folds over itself.
    place_mm : (x, y, z), mm
        Where they are nearest to each other.
    apart_mm : float, mm
        How much further apart they would have to be there, at least.
    needle_mm : float, mm
        Outer diameter of a needle's tip with which the two can be written; 0 where none was found.
    """

    vessel: int
    other: int
    place_mm: tuple[float, float, float]
    apart_mm: float
    needle_mm: float


@dataclass(frozen=True)
class Merged:
    """Two vessels that overlap in the design though they share no node there.

    Their ink becomes one; the shaft passes through it as through a joint.

    Attributes
    ----------
    vessel, other : int
    overlap_mm : float, mm
        Deepest.
    """

    vessel: int
    other: int
    overlap_mm: float


@dataclass(frozen=True)
class WeakJoint:
    """Two stretches that meet and can't be made to overlap by the requested length.

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


@dataclass(frozen=True)
class EmbeddedReport:
    """Figures of an embedded plan.

    Attributes
    ----------
    vessels, passes : int
        Vessels of the network, and starts of the needle.
    crossings : tuple of Crossing
        Where the shaft passes through what was written before, the longest first; empty for a plan
        without harm. Ink of a joint doesn't count (`needle.joint_reach`).
    grazes : tuple of Crossing
        Where it comes nearer than the clearance.
    merged : tuple of Merged
        The network's own collisions, the deepest first.
    joints, overlapped, continued : int
        Ends and ways through nodes that meet something already written; of these, those overlapped
        by a tangent extension, and those written without a stop.
    shortened, open : tuple of WeakJoint
        Of the overlaps, those shorter than asked because no side had room for more; joints that
        can't be overlapped.
    left_out : tuple of OmittedVessel
        Vessels that aren't written, since no order keeps needle and ink apart.
    cut_off : tuple of int
        Written vessels to which no designed flow leads without those.
    design_ul, overlap_ul, written_ul : float, µL
        Σ π r² L of what is written of the network, ink in the overlaps, and their sum as planned.
    written_mm, travel_mm : float, mm
    write_s, travel_s : float, s
        At constant speed, without acceleration; travel includes lifts.
    waited_s : float, s
        In dwells: for the ink to flow, and for the bath to close behind the needle.
    slowest_mm_s, fastest_mm_s : float, mm/s
        While writing.
    """

    vessels: int
    passes: int
    crossings: tuple[Crossing, ...]
    grazes: tuple[Crossing, ...]
    merged: tuple[Merged, ...]
    joints: int
    overlapped: int
    continued: int
    shortened: tuple[WeakJoint, ...]
    open: tuple[WeakJoint, ...]
    left_out: tuple[OmittedVessel, ...]
    cut_off: tuple[int, ...]
    design_ul: float
    overlap_ul: float
    written_ul: float
    written_mm: float
    travel_mm: float
    write_s: float
    travel_s: float
    waited_s: float
    slowest_mm_s: float
    fastest_mm_s: float


class BrushedOverlap(NamedTuple):
    """An overlap that the shaft meets while a later element is written, or ink met from one."""

    element: int  # the later one, or that which the overlap goes on from
    end: int  # the earlier one: that which the overlap goes on from, or ink
    entered: bool  # whether the needle itself meets it, or its clearance only


@dataclass
class JoinedPasses:
    """Embedded passes extended to overlap at their joints."""

    before: FloatArray  # (p,), mm, how far each pass begins before its first point
    beyond: FloatArray  # (p,), mm, how far it goes on beyond its last
    joints: int = 0  # ends that come to ink
    overlapped: int = 0  # of these, those closed by an overlap
    through: int = 0  # stretches that go on from the last one through a node without a stop
    open: list[WeakJoint] = field(default_factory=list)  # without an overlap
    shortened: list[WeakJoint] = field(default_factory=list)  # with less overlap than requested
    brushed: list[BrushedOverlap] = field(default_factory=list)
    # Elements of which the first, written before the second, would leave room for an overlap.
    reorderings: list[tuple[int, int]] = field(default_factory=list)
