"""Find overlaps of a network's filaments in the design, away from their common nodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray
from sim.gcode.clearance.network import WrittenNetwork

DEEP: Final = 0.25
"""Two filaments are one body where they reach so far into each other, in radii of the thinner one.
Where they only brush each other the needle may as well stay out."""
TURN: Final = 0.7
"""Of the way along the vessels, the gap between two places: below it the way has turned by more
than a right angle, or forks at less. A thick vessel's own way ahead is near, too."""
FINEST_MM: Final = 0.05
COARSEST_MM: Final = 0.1


@dataclass(frozen=True)
class Overlaps:
    """Pairs of places.

    Attributes
    ----------
    vessel : (k, 2) int64
        The lower number first.
    along : (k, 2) float64, mm
        Way along either.
    overlap : (k,) float64, mm
        By which the filaments reach into each other.
    gap : (k,) float64, mm
        Between their axes.
    """

    vessel: IntArray
    along: FloatArray
    overlap: FloatArray
    gap: FloatArray


@dataclass(frozen=True)
class _Spots:
    """Places along all vessels: (n, 3) mm, and of each its vessel, way along it, and radius."""

    place: FloatArray
    vessel: IntArray
    along: FloatArray
    radius: FloatArray


def overlaps_of(network: WrittenNetwork, radius_mm: float, overlap_radii: float) -> Overlaps:
    """Find where filaments overlap as far from their common nodes as a joint reaches, or further.

    Parameters
    ----------
    network : WrittenNetwork
    radius_mm : float, mm
        Of the bare shaft.
    overlap_radii : float
    """
    spots = _spots(network)
    one, other, gap = _near(spots)
    thin = np.minimum(spots.radius[one], spots.radius[other])
    thick = np.maximum(spots.radius[one], spots.radius[other])
    deep = thin + thick - gap
    reach = np.sqrt(2.0) * (radius_mm + thick) + overlap_radii * thick
    way, joined = _through_nodes(network, spots, one, other, reach)
    deep_enough = (deep >= DEEP * thin) & ~joined & (gap < TURN * way)
    pair = np.column_stack([one, other])[deep_enough]
    order = np.argsort(spots.vessel[pair], axis=1, kind="stable")
    pair = np.take_along_axis(pair, order, axis=1)
    return Overlaps(spots.vessel[pair], spots.along[pair], deep[deep_enough], gap[deep_enough])


def _spots(network: WrittenNetwork) -> _Spots:
    """Every vessel cut into stretches of half its least radius."""
    count = np.diff(network.offset)
    finest = np.minimum.reduceat(network.radius, network.offset[:-1]) / 2
    pitch = np.repeat(finest.clip(FINEST_MM, COARSEST_MM), count)
    length = np.diff(network.arc, append=0.0)
    length[network.offset[1:] - 1] = 0.0
    parts = np.maximum(np.ceil(length / pitch), 1).astype(np.int64)
    row = np.repeat(np.arange(len(parts)), parts)
    share = (np.arange(len(row)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[row]
    following = np.minimum(row + 1, len(parts) - 1)
    mixed = [
        values[row] + (share * (values[following] - values[row]).T).T
        for values in (network.points, network.arc, network.radius)
    ]
    return _Spots(mixed[0], np.repeat(np.arange(len(count)), count)[row], mixed[1], mixed[2])


def _near(spots: _Spots) -> tuple[IntArray, IntArray, FloatArray]:
    """Pairs that may overlap, and the gaps: looked for by octaves of the radius."""
    from scipy.spatial import cKDTree  # loads for 0.3 s; few jobs come here

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


def _through_nodes(
    network: WrittenNetwork, spots: _Spots, one: IntArray, other: IntArray, reach: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Way along vessels through one node at most (inf: none), and whether a joint has both."""
    u, v = spots.vessel[one], spots.vessel[other]
    apart = np.abs(spots.along[one] - spots.along[other])
    way = np.where(u == v, apart, np.inf)
    joined = (u == v) & (apart <= reach)
    for a in (0, 1):
        for b in (0, 1):
            meet = network.vessel_nodes[u, a] == network.vessel_nodes[v, b]
            meet &= (u != v) | (a != b)
            first = np.abs(spots.along[one] - a * network.lengths[u])
            second = np.abs(spots.along[other] - b * network.lengths[v])
            way = np.where(meet, np.minimum(way, first + second), way)
            joined |= meet & (np.maximum(first, second) <= reach)
    return way, joined
