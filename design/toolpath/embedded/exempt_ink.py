"""Compute the length of ink at vessel joints that the needle shaft check leaves out."""

from __future__ import annotations

from itertools import permutations
from typing import Final, NamedTuple

import numpy as np

from design.network import VesselNetwork
from design.toolpath.embedded.needle import Needle, joint_reach
from design.toolpath.embedded.touches import CELL_MM, Touches, arcs_of
from kernels import jit
from kernels.arrays import FloatArray, IntArray

PAST_MM: Final = 0.002
"""Rounding of a place at a vessel's end."""


class MeetingVessels(NamedTuple):
    """Where vessels meet, those of vessel ``v`` in ``begin[v]:begin[v + 1]``.

    Attributes
    ----------
    begin : (v + 1,) int64
    other : (m,) int64
        The vessel met, ascending for each vessel.
    own, there : (m,) float64, mm
        Way along the vessel, ascending for each other, and along that one.
    wide : (m,) float64, mm
        How far the place reaches to either side: 0 for a node.
    gap : (m,) float64, mm
        From one axis to the other: 0 for a node.
    lumen_mm : (v,) float64, mm
        Radius of a vessel that is a bundle of strands, by which its joints reach; 0 for others.
    length : (v,) float64, mm
    """

    begin: IntArray
    other: IntArray
    own: FloatArray
    there: FloatArray
    wide: FloatArray
    gap: FloatArray
    lumen_mm: FloatArray
    length: FloatArray


def exempt_lengths(
    network: VesselNetwork, touches: Touches, lumen_mm: FloatArray
) -> MeetingVessels:
    """Nodes and touches of a network, in the vessels' own lengths."""
    length = arcs_of(network)[1]
    ends: dict[int, list[tuple[int, float]]] = {}
    for vessel, (tail, head) in enumerate(network.vessel_nodes.tolist()):
        ends.setdefault(tail, []).append((vessel, 0.0))
        ends.setdefault(head, []).append((vessel, float(length[vessel])))
    nodes = [
        (v, w, a, b, 0.0, 0.0) for met in ends.values() for (v, a), (w, b) in permutations(met, 2)
    ]
    (u, v), (a, b) = touches.vessel.T, touches.arc.T
    wide = np.full(len(u), CELL_MM / 2)
    rows = np.concatenate([
        np.array(nodes, dtype=np.float64).reshape(-1, 6),
        np.column_stack([u, v, a, b, wide, touches.gap]),
        np.column_stack([v, u, b, a, wide, touches.gap]),
    ])  # fmt: skip
    rows = rows[np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0]))]
    count = np.bincount(rows[:, 0].astype(np.int64), minlength=network.vessel_count)
    begin = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    own, there, wide, gap = (np.ascontiguousarray(column) for column in rows[:, 2:].T)
    return MeetingVessels(
        begin, rows[:, 1].astype(np.int64), own, there, wide, gap, lumen_mm, length
    )


@jit
def reach_of(
    vessel: int, radius: float, other: int, thick: float, spared: MeetingVessels, needle: Needle
) -> float:
    """How far the joint of a filament with another one goes, mm."""
    wide = max(radius, thick, spared.lumen_mm[vessel], spared.lumen_mm[other])
    return joint_reach(needle, wide)


@jit
def meetings_between(vessel: int, other: int, spared: MeetingVessels) -> tuple[int, int]:
    """Range of the places where two vessels meet."""
    begin, end = spared.begin[vessel], spared.begin[vessel + 1]
    low = begin + np.searchsorted(spared.other[begin:end], other)
    return low, begin + np.searchsorted(spared.other[begin:end], other + 1)


@jit
def past_other_end(vessel: int, at: float, end: float, spared: MeetingVessels) -> float:
    """How far a place lies past the vessel's other end than ``end``, mm; below 0 before it.

    What lies past an end lies where another vessel is, and belongs to that end's joint alone.
    """
    return -at if end > 0.0 else at - spared.length[vessel]


@jit
def inside_joint(
    vessel: int,
    at: float,
    left: float,
    other: int,
    there: float,
    reach: float,
    spared: MeetingVessels,
) -> float:
    """How far inside a joint ink ``there`` along a vessel lies, mm; below 0 it is outside.

    The tip is ``at`` mm along its vessel; ``left`` of the joint's reach is not yet used up by its
    way from or to there.
    """
    best = left - abs(there - at) if vessel == other else -np.inf
    low, high = meetings_between(vessel, other, spared)
    most = left + CELL_MM
    for m in range(low + np.searchsorted(spared.own[low:high], at - most), high):
        if spared.own[m] > at + most:
            break
        tip = left - abs(spared.own[m] - at) - spared.gap[m]
        here = min(tip, reach - abs(spared.there[m] - there)) + spared.wide[m]
        if spared.wide[m] == 0.0:
            past = past_other_end(vessel, at, spared.own[m], spared)
            past = max(past, past_other_end(other, there, spared.there[m], spared))
            here = min(here, PAST_MM - past)
        best = max(best, here)
    return float(best)
