"""Find filaments that merge although the design keeps their vessels separate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.spatial import cKDTree

from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray
from printctl.checks.lumens.filaments import in_short_pieces
from sim.gcode.deposit.strands import Strands

APART_MM: Final = 0.02
"""Designed walls thinner than that are taken as meeting."""
STRAY_RADII: Final = 1.5
"""Farther from every designed axis, in designed radii, a filament is of no vessel."""
SAMPLE_MM: Final = 0.2


@dataclass(frozen=True)
class Merge:
    """Two vessels whose filaments merge.

    Attributes
    ----------
    vessels, trees : (int, int)
    at_mm : (3,) float64, mm
        In the filaments' frame.
    neck_mm : float, mm
        Width of the widest opening between them.
    """

    vessels: tuple[int, int]
    trees: tuple[int, int]
    at_mm: FloatArray
    neck_mm: float

    @property
    def across_trees(self) -> bool:
        """Whether blood would change from one tree to another."""
        return self.trees[0] != self.trees[1]

    def as_dict(self, place_mm: FloatArray) -> dict[str, Any]:
        """For JSON, in the part's frame."""
        return {
            "vessels": list(self.vessels),
            "trees": list(self.trees),
            "at_mm": (self.at_mm - place_mm).tolist(),
            "neck_mm": self.neck_mm,
        }


def find_merges(
    strands: Strands, network: VesselNetwork, place_mm: FloatArray, width_mm: float
) -> tuple[Merge, ...]:
    """Pairs of vessels whose filaments overlap by at least ``width_mm`` where the design doesn't.

    Of each pair the widest neck: the circle in which the two balls meet, or the thinner filament
    where one lies in the other.

    Parameters
    ----------
    strands : Strands
    network : VesselNetwork
        In the part's frame.
    place_mm : (3,) float64, mm
        The part's origin in the filaments' frame.
    width_mm : float, mm
    """
    pieces = in_short_pieces(strands)
    start, end, r0, r1, vessel = network.pieces()
    start, end, radius = start + place_mm, end + place_mm, np.maximum(r0, r1)
    owner = owners(pieces, start, end, radius)
    kept = np.flatnonzero(owner >= 0)
    one, other = _near(pieces, kept)
    apart = vessel[owner[one]] != vessel[owner[other]]
    one, other = one[apart], other[apart]
    away, at = segment_distances(
        pieces.start[one], pieces.end[one], pieces.start[other], pieces.end[other]
    )
    neck = necks(away, pieces.radius[one], pieces.radius[other])
    mine, its = owner[one], owner[other]
    designed, _ = segment_distances(start[mine], end[mine], start[its], end[its])
    new = (neck >= width_mm) & (designed - radius[mine] - radius[its] > APART_MM)
    worst: dict[tuple[int, int], int] = {}
    for k in np.flatnonzero(new)[np.argsort(neck[new], kind="stable")]:
        pair = sorted((int(vessel[mine[k]]), int(vessel[its[k]])))
        worst[(pair[0], pair[1])] = int(k)
    trees = network.tree
    return tuple(
        Merge(pair, (int(trees[pair[0]]), int(trees[pair[1]])), at[k], float(neck[k]))
        for pair, k in sorted(worst.items())
    )


def owners(pieces: Strands, start: FloatArray, end: FloatArray, radius: FloatArray) -> IntArray:
    """Piece of the design along which each filament's piece lies, (n,); -1 for none.

    The nearest axis, sampled every `SAMPLE_MM`; none where it is farther than `STRAY_RADII`.
    """
    length = np.linalg.norm(end - start, axis=1)
    count = np.maximum(np.ceil(length / SAMPLE_MM), 1).astype(np.int64)
    of = np.repeat(np.arange(len(count)), count)
    within = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    samples = start[of] + ((within + 0.5) / count[of])[:, None] * (end - start)[of]
    away, nearest = cKDTree(samples).query((pieces.start + pieces.end) / 2)
    owner = of[nearest]
    far = away > STRAY_RADII * radius[owner] + SAMPLE_MM / 2
    return np.where(far, -1, owner).astype(np.int64)


def _near(pieces: Strands, kept: IntArray) -> tuple[IntArray, IntArray]:
    """Pairs of pieces that may touch."""
    nothing = np.zeros(0, np.int64)
    if len(kept) < 2:
        return nothing, nothing
    middle = (pieces.start + pieces.end)[kept] / 2
    half = np.linalg.norm((pieces.end - pieces.start)[kept], axis=1) / 2
    reach = half + pieces.radius[kept]
    pairs = cKDTree(middle).query_pairs(2 * float(reach.max()), output_type="ndarray")
    gap = np.linalg.norm(middle[pairs[:, 0]] - middle[pairs[:, 1]], axis=1)
    pairs = pairs[gap <= reach[pairs].sum(axis=1)]
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    return kept[pairs[:, 0]], kept[pairs[:, 1]]


def necks(away: FloatArray, one: FloatArray, other: FloatArray) -> FloatArray:
    """Width (n,) of the opening between two balls with middles ``away`` from each other, mm."""
    thin = np.minimum(one, other)
    inside = away <= np.abs(one - other)
    safe = np.where(inside, 1.0, away)
    plane = (safe**2 + one**2 - other**2) / (2 * safe)
    lens = np.sqrt(np.maximum(one**2 - plane**2, 0.0))
    return np.where(away >= one + other, 0.0, 2 * np.where(inside, thin, np.minimum(lens, thin)))


def segment_distances(
    a0: FloatArray, a1: FloatArray, b0: FloatArray, b1: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Least distance between straight pieces (n, 3), and the place midway, mm.

    Nearest points of the two lines, cut to the one piece, then to the other, and back (Ericson,
    Real-Time Collision Detection, 2005, section 5.1.9).
    """
    d, e, gap = a1 - a0, b1 - b0, a0 - b0
    dd, ee, de = (d * d).sum(axis=1), (e * e).sum(axis=1), (d * e).sum(axis=1)
    dg, eg = (d * gap).sum(axis=1), (e * gap).sum(axis=1)
    tiny = 1e-18
    spread = dd * ee - de**2
    s = np.where(spread > tiny, (de * eg - dg * ee) / np.where(spread > tiny, spread, 1.0), 0.0)
    s = np.clip(s, 0.0, 1.0)
    t = np.clip((de * s + eg) / np.maximum(ee, tiny), 0.0, 1.0)
    s = np.clip((de * t - dg) / np.maximum(dd, tiny), 0.0, 1.0)
    one, other = a0 + s[:, None] * d, b0 + t[:, None] * e
    return np.linalg.norm(one - other, axis=1), (one + other) / 2
