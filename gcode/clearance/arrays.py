"""Input arrays of the shaft check's kernels: printed ink, moving tips, vessel joints."""

from __future__ import annotations

from typing import NamedTuple

from kernels.arrays import FloatArray, IntArray

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
