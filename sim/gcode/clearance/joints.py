"""Find a network's joints for the shaft check: nodes, and overlaps of vessel filaments."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations
from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from sim.gcode.clearance.bodies import Joints
from sim.gcode.clearance.network import WrittenNetwork
from sim.gcode.clearance.overlaps import Overlaps, overlaps_of

_GRAIN_MM: Final = 0.05
_GRAIN_FROM: Final = 0.3183
"""Overlapping places are kept once for each cell of that size along both vessels, as its middle.
Cells begin at such a part of one, where no spot of a straight vessel of round length lies."""


@dataclass(frozen=True)
class DesignedOverlap:
    """Two vessels without a common node whose filaments are one body in the design.

    Attributes
    ----------
    vessel, other : int
        The same one where it meets itself.
    overlap_mm : float, mm
        Deepest.
    place_mm : (x, y, z), mm
        There, on the first one's axis.
    """

    vessel: int
    other: int
    overlap_mm: float
    place_mm: tuple[float, float, float]


def joints_of(
    network: WrittenNetwork, radius_mm: float, overlap_radii: float
) -> tuple[Joints, tuple[DesignedOverlap, ...]]:
    """What counts as a joint for a shaft, and which of it no node explains, the deepest first."""
    overlaps = overlaps_of(network, radius_mm, overlap_radii)
    cells = np.floor(overlaps.along / _GRAIN_MM + _GRAIN_FROM)
    nearest = np.argsort(overlaps.gap, kind="stable")
    keys = np.column_stack([overlaps.vessel, cells])[nearest]
    keys, first = np.unique(keys, axis=0, return_index=True)
    gap = overlaps.gap[nearest[first]]
    u, v, a, b = keys.T
    a, b = ((one + 0.5 - _GRAIN_FROM) * _GRAIN_MM for one in (a, b))
    forth, back = np.column_stack([u, v, a, b, gap]), np.column_stack([v, u, b, a, gap])
    at_nodes = _at_nodes(network)
    rows = np.concatenate([at_nodes, forth, back])
    wide = np.where(np.arange(len(rows)) < len(at_nodes), 0.0, _GRAIN_MM / 2)
    order = np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0]))
    rows, wide = rows[order], wide[order]
    count = np.bincount(rows[:, 0].astype(np.int64), minlength=network.vessel_count)
    begin = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    other, own, there, gap = (np.ascontiguousarray(column) for column in rows[:, 1:].T)
    met = other.astype(np.int64)
    lumens = network.lumen_mm
    joints = Joints(
        begin, met, own, there, wide, gap, radius_mm, overlap_radii, lumens, network.lengths
    )
    return joints, _designed_overlaps(network, overlaps)


def _at_nodes(network: WrittenNetwork) -> FloatArray:
    """Each end of a vessel with all others at its node: vessel, other, way along both."""
    ends: dict[int, list[tuple[int, float]]] = {}
    for vessel, (tail, head) in enumerate(network.vessel_nodes.tolist()):
        ends.setdefault(tail, []).append((vessel, 0.0))
        ends.setdefault(head, []).append((vessel, float(network.lengths[vessel])))
    rows = [(v, w, a, b, 0.0) for meet in ends.values() for (v, a), (w, b) in permutations(meet, 2)]
    return np.array(rows, dtype=np.float64).reshape(-1, 5)


def _designed_overlaps(network: WrittenNetwork, overlaps: Overlaps) -> tuple[DesignedOverlap, ...]:
    """Once for each pair; vessels that leave a node side by side overlap for a while anyway."""
    ends = network.vessel_nodes[overlaps.vessel]
    shared = (ends[:, 0, :, None] == ends[:, 1, None, :]).any(axis=(1, 2))
    shared &= overlaps.vessel[:, 0] != overlaps.vessel[:, 1]
    order = np.argsort(-overlaps.overlap, kind="stable")
    order = order[~shared[order]]
    once = np.unique(overlaps.vessel[order], axis=0, return_index=True)[1]
    return tuple(
        DesignedOverlap(
            int(overlaps.vessel[k, 0]),
            int(overlaps.vessel[k, 1]),
            round(float(overlaps.overlap[k]), 4),
            network.place(int(overlaps.vessel[k, 0]), float(overlaps.along[k, 0])),
        )
        for k in order[np.sort(once)].tolist()
    )
