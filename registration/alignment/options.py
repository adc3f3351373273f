"""What an alignment searches, and its limits."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class AlignmentOptions:
    """Search and limits.

    Attributes
    ----------
    turns : int
        Starts around the vertical.
    tilt_deg : float, degrees
        Tilt of the tilted starts.
    shift_mm : float, mm
        Shift of the shifted starts.
    coarse_points, fine_points, contest_points : int
        Surface points used while searching, for the final fits, and to compare poses.
    depth_span_mm : float, mm
        The part's depth in view from which the depth scale is fitted; below, a scale can't be
        told from an error of the refractive index.
    distinct_mm : float, mm
        Poses that move no point of the part by more than this are the same.
    ambiguous_below : float
        Lead (see `contest`) of the pose over the best wrong one below which it is ambiguous.
    """

    turns: int = 72
    tilt_deg: float = 7.0
    shift_mm: float = 1.5
    coarse_points: int = 1500
    fine_points: int = 20_000
    contest_points: int = 60_000
    depth_span_mm: float = 2.0
    distinct_mm: float = 0.3
    ambiguous_below: float = 1.5
