"""Data classes of an embedded plan's report: times, crossings, open joints, omitted vessels."""

from __future__ import annotations

from dataclasses import dataclass

from design.toolpath.embedded.joined import WeakJoint


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
