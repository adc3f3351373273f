"""Options of aligning a scan: starts tried, points used, limit of ambiguity."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class AlignmentOptions:
    """Options and limits of an alignment.

    Attributes
    ----------
    cover : int
        Orientations tried, spread evenly over all there are.
    descents : int
        The best of these, improved.
    orientations, places : int
        Distinct ones kept of these, and places tried of each where the view is partial.
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

    cover: int = 1500
    descents: int = 160
    orientations: int = 16
    places: int = 4
    coarse_points: int = 1500
    fine_points: int = 20_000
    contest_points: int = 60_000
    depth_span_mm: float = 2.0
    distinct_mm: float = 0.3
    ambiguous_below: float = 1.5
