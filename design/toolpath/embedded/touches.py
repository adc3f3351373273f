"""Places where a network's filaments overlap away from their nodes: its own collisions."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.needle import JOINT, Needle
from design.toolpath.toolpath import FloatArray, IntArray

BESIDE: Final = 0.7
"""Filaments touch where they are nearer than this part of the way along vessels: what lies ahead
on a thick vessel is near, too, but no collision."""
PARTING_MM: Final = 0.1
"""Filaments that part so near to a joint's border are no place for a needle."""
DEEP: Final = 0.25
"""Filaments are one body where they reach so far into each other, in radii of the thinner one.
Where they only brush each other the order still matters."""
FINEST_MM: Final = 0.05
COARSEST_MM: Final = 0.1
"""Of the places that are looked at: half the vessel's least radius, between these two."""


class Touches(NamedTuple):
    """Pairs of places.

    Attributes
    ----------
    vessel : (k, 2) int64
    arc : (k, 2) float64, mm
        Way along either vessel.
    overlap : (k,) float64, mm
        By which the two reach into each other.
    """

    vessel: IntArray
    arc: FloatArray
    overlap: FloatArray


class _Spots(NamedTuple):
    """Places along all vessels: (n, 3) mm, and of each its vessel, way along it, and radius."""

    place: FloatArray
    vessel: IntArray
    arc: FloatArray
    radius: FloatArray


def touches(elements: Elements, needle: Needle) -> Touches:
    """Where filaments overlap further from their common nodes than a joint reaches.

    What overlaps is one body when both are written, whichever comes first; the shaft passes through
    it there as through a joint. Whether the design means it is the designer's to say.
    """
    spots = _spots(elements)
    one, other, gap = _near(spots)
    thin = np.minimum(spots.radius[one], spots.radius[other])
    thick = np.maximum(spots.radius[one], spots.radius[other])
    deep = thin + thick - gap
    reach = JOINT * (needle.joint_mm + thick) + needle.overlap_radii * thick - PARTING_MM
    way, joined = _ways(elements, spots, one, other, reach)
    rows = np.flatnonzero((deep >= DEEP * thin) & ~joined & (gap < BESIDE * way))
    pair = np.column_stack([one, other])[rows]
    vessel, arc = spots.vessel[pair], spots.arc[pair]
    return _thinned(Touches(vessel, arc, deep[rows]))


def _thinned(found: Touches) -> Touches:
    """The deepest of those that lie within `FINEST_MM` along both vessels."""
    order = np.argsort(-found.overlap, kind="stable")
    cell = np.column_stack([found.vessel, np.floor(found.arc / FINEST_MM)])[order]
    rows = np.sort(order[np.unique(cell, axis=0, return_index=True)[1]])
    return Touches(found.vessel[rows], found.arc[rows], found.overlap[rows])


def _spots(elements: Elements) -> _Spots:
    least = np.minimum.reduceat(elements.radius.min(axis=1), elements.first[:-1]) / 2
    pitch = least.clip(FINEST_MM, COARSEST_MM)[elements.vessel]
    parts = np.maximum(np.ceil(elements.length / pitch), 1).astype(np.int64)
    row = np.repeat(np.arange(len(parts)), parts)
    share = (np.arange(len(row)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[row]
    ends = elements.first[1:] - 1  # and the far end of each vessel
    row, share = np.append(row, ends), np.append(share, np.ones(len(ends)))
    start, end = elements.point[elements.end[row, 0]], elements.point[elements.end[row, 1]]
    r0, r1 = elements.radius[row].T
    return _Spots(
        start + share[:, None] * (end - start),
        elements.vessel[row],
        elements.arc[row] + share * elements.length[row],
        r0 + share * (r1 - r0),
    )


def _near(spots: _Spots) -> tuple[IntArray, IntArray, FloatArray]:
    """Pairs nearer than their radii's sum may be, by octaves of the radius, and their gaps."""
    octave = np.floor(np.log2(np.maximum(spots.radius, 1e-9))).astype(np.int64)
    rows = {k: np.flatnonzero(octave == k) for k in np.unique(octave).tolist()}
    trees = {k: cKDTree(spots.place[own]) for k, own in rows.items()}
    parts = []
    for a in rows:
        for b in (k for k in rows if k >= a):
            far = float(spots.radius[rows[a]].max() + spots.radius[rows[b]].max())
            near = trees[a].sparse_distance_matrix(trees[b], far, output_type="ndarray")
            one, other = rows[a][near["i"]], rows[b][near["j"]]
            kept = (a != b) | (one < other)
            parts.append((one[kept], other[kept], near["v"][kept]))
    one, other, gap = (np.concatenate(column) for column in zip(*parts, strict=True))
    return one, other, gap


def _ways(
    elements: Elements, spots: _Spots, one: IntArray, other: IntArray, reach: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Way along vessels through one node at most (inf: none), and whether a joint has both."""
    low, high = elements.first[:-1], elements.first[1:] - 1
    node = np.column_stack([elements.end[low, 0], elements.end[high, 1]])
    length = np.add.reduceat(elements.length, low)
    u, v = spots.vessel[one], spots.vessel[other]
    apart = np.abs(spots.arc[one] - spots.arc[other])
    way = np.where(u == v, apart, np.inf)
    joined = (u == v) & (apart <= reach)
    for a in (0, 1):
        for b in (0, 1):
            meet = (node[u, a] == node[v, b]) & ((u != v) | (a != b))
            here = np.abs(spots.arc[one] - a * length[u])
            there = np.abs(spots.arc[other] - b * length[v])
            way = np.where(meet, np.minimum(way, here + there), way)
            joined |= meet & (np.maximum(here, there) <= reach)
    return way, joined
