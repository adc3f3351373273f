"""What was planned, in numbers."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Crossing:
    """A shaft that passes through what is written.

    Attributes
    ----------
    vessel, through : int
        While `vessel` is written, the shaft passes through vessel `through` (itself, where a
        vessel folds over itself).
    length_mm : float, mm
        Along `vessel`.
    """

    vessel: int
    through: int
    length_mm: float


@dataclass(frozen=True)
class EmbeddedReport:
    """Embedded writing in numbers.

    Attributes
    ----------
    pieces, passes : int
        Pieces written, and starts of the needle: pieces that go on from the last one need none.
    crossings : tuple of Crossing
        Where the shaft passes through what was written before, the longest first; empty for a
        plan without harm. Found on the pieces as written, overlaps included, with the shaft's
        clearance; what lies within √2 (R + r) plus the overlap of a shared node is the joint and
        doesn't count.
    joints, overlapped, continued : int
        Piece ends that meet something already written; of these, those overlapped by a tangent
        extension and those written without a stop. The sum of the last two is the first, unless
        the overlap is 0.
    design_ul, overlap_ul, written_ul : float, µL
        Σ π r² L of the network, ink in the overlaps, and their sum as planned.
    written_mm, travel_mm : float, mm
    write_s, travel_s : float, s
        At constant speed, without acceleration; travel includes lifts.
    slowest_mm_s, fastest_mm_s : float, mm/s
        While writing.
    """

    pieces: int
    passes: int
    crossings: tuple[Crossing, ...]
    joints: int
    overlapped: int
    continued: int
    design_ul: float
    overlap_ul: float
    written_ul: float
    written_mm: float
    travel_mm: float
    write_s: float
    travel_s: float
    slowest_mm_s: float
    fastest_mm_s: float
