"""Designed network as plain arrays, for the shaft check: vessels and nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcode.clearance.arrays import Joints
from gcode.errors import ClearanceError
from kernels.arrays import FloatArray, IntArray, split_rows

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


_AT_END_MM: Final = 0.01
"""So near to its end a place on a closed vessel may as well lie at the other one."""


@dataclass(frozen=True)
class WrittenNetwork:
    """Vessels and nodes, in the frame of the motion.

    Attributes
    ----------
    nodes : (m, 3) float64, mm
    vessel_nodes : (v, 2) int64
        First and last node of each vessel.
    offset : (v + 1,) int64
        Points of vessel ``i`` are ``offset[i]:offset[i + 1]``.
    points : (p, 3) float64, mm
    radius : (p,) float64, mm
    bundled : (v,) bool or None
        Vessels that are written as several strands around their axes; None for none.

    Raises
    ------
    ClearanceError
        When the arrays don't belong together.
    """

    nodes: FloatArray
    vessel_nodes: IntArray
    offset: IntArray
    points: FloatArray
    radius: FloatArray
    bundled: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        vessels, points = len(self.vessel_nodes), len(self.points)
        sound = (
            self.vessel_nodes.shape == (vessels, 2)
            and self.nodes.shape == (len(self.nodes), 3)
            and self.points.shape == (points, 3)
            and self.radius.shape == (points,)
            and self.offset.shape == (vessels + 1,)
            and (np.diff(self.offset) >= 2).all()
            and (vessels == 0 or int(self.offset[-1]) == points)
            and (self.bundled is None or self.bundled.shape == (vessels,))
            and self.vessel_nodes.min(initial=0) >= 0
            and self.vessel_nodes.max(initial=-1) < len(self.nodes)
        )
        if not sound:
            raise ClearanceError(
                f"a network of {vessels} vessels, {points} points and {len(self.nodes)} nodes "
                "whose arrays don't belong together; make its file anew"
            )

    @property
    def vessel_count(self) -> int:
        """Number of vessels."""
        return len(self.vessel_nodes)

    def moved(self, by_mm: FloatArray) -> WrittenNetwork:
        """The same, elsewhere."""
        return replace(self, nodes=self.nodes + by_mm, points=self.points + by_mm)

    @property
    def lumen_mm(self) -> FloatArray:
        """Widest radius of each bundled vessel, (v,), mm; 0 of one written as one filament."""
        if self.bundled is None or not self.vessel_count:
            return np.zeros(self.vessel_count)
        return np.where(self.bundled, np.maximum.reduceat(self.radius, self.offset[:-1]), 0.0)

    @cached_property
    def arc(self) -> FloatArray:
        """Of each point along its vessel, (p,), mm."""
        step = np.linalg.norm(np.diff(self.points, axis=0, prepend=self.points[:1]), axis=1)
        whole = np.cumsum(step)
        return np.asarray(whole - np.repeat(whole[self.offset[:-1]], np.diff(self.offset)))

    @cached_property
    def _axes(self) -> dict[int, Axis]:
        """Axes found so far."""
        return {}

    @cached_property
    def lengths(self) -> FloatArray:
        """Of each vessel, (v,), mm."""
        return self.arc[self.offset[1:] - 1]

    def spans(
        self, vessel: IntArray, start: FloatArray, end: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Way along their vessels, and radius there, (n, 2) mm, of straight rows' two ends.

        A row that goes on past its vessel's end counts on: below 0, or above the vessel's length.
        Else what lies between its ends, found by their share, would be as far off. Where a vessel
        comes back to its first point a row has the side on which it lies.
        """
        twice, ends = np.concatenate([vessel, vessel]), np.concatenate([start, end])
        both = self.project(twice, ends)
        both = both[0] + self._past_end(twice, ends, both[0]), both[1]
        along, radius = (np.column_stack(np.split(one, 2)) for one in both)
        whole = np.where(vessel >= 0, self.lengths[vessel], 0.0) if len(self.lengths) else 0.0
        for k in (0, 1):
            closing = (whole > 0) & (np.minimum(along[:, k], whole - along[:, k]) < _AT_END_MM)
            other, at = np.where(along[:, k] < whole / 2, whole, 0.0), along[:, 1 - k]
            turned = closing & self._closed[vessel] & (np.abs(along[:, k] - at) > whole / 2)
            along[:, k] = np.where(turned & (at != other), other, along[:, k])
        return along, radius

    def _past_end(self, vessel: IntArray, place: FloatArray, along: FloatArray) -> FloatArray:
        """How far places (n, 3) lie past the end of their vessel that they project on, (n,), mm.

        Below 0 past the first end. Vessel -1 is none.
        """
        past = np.zeros(len(vessel))
        if not self.vessel_count:
            return past
        own = np.where(vessel >= 0, vessel, 0)
        for end, step, here in (
            (self.offset[:-1], 1, along <= 0.0),
            (self.offset[1:] - 1, -1, along >= self.lengths[own]),
        ):
            rows = np.flatnonzero(here & (vessel >= 0))
            at = end[own[rows]]
            out = self.points[at] - self.points[at + step]
            out /= np.linalg.norm(out, axis=1, keepdims=True)
            past[rows] = -step * np.maximum(((place[rows] - self.points[at]) * out).sum(axis=1), 0)
        return past

    @cached_property
    def _closed(self) -> NDArray[np.bool_]:
        """Vessels that end where they begin, (v,); one more for none."""
        return np.append(self.vessel_nodes[:, 0] == self.vessel_nodes[:, 1], False)

    def project(self, vessel: IntArray, place: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest place along a vessel's axis, and the radius there.

        Parameters
        ----------
        vessel : (n,) int64
            -1 for none.
        place : (n, 3) float64, mm

        Returns
        -------
        along : (n,) float64, mm
            From the vessel's first point; 0 for none.
        radius : (n,) float64, mm
            1 for none.
        """
        along, radius = np.zeros(len(vessel)), np.ones(len(vessel))
        order = np.argsort(vessel, kind="stable")
        cuts = np.searchsorted(vessel[order], np.arange(self.vessel_count + 1))
        for v in np.unique(vessel[vessel >= 0]).tolist():
            rows = order[cuts[v] : cuts[v + 1]]
            points = slice(int(self.offset[v]), int(self.offset[v + 1]))
            arc = self.arc[points]
            if v not in self._axes:
                self._axes[v] = Axis.of(self.points[points], arc)
            along[rows] = self._axes[v].nearest(place[rows])
            radius[rows] = np.interp(along[rows], arc, self.radius[points])
        return along, radius

    def place(self, vessel: int, along_mm: float) -> tuple[float, float, float]:
        """Where on the axis of a vessel such a way along it ends, mm."""
        own = slice(int(self.offset[vessel]), int(self.offset[vessel + 1]))
        x, y, z = (
            round(float(np.interp(along_mm, self.arc[own], self.points[own, k])), 3)
            for k in range(3)
        )
        return x, y, z


_SPACING_MM: Final = 0.05
"""Of the places among which the nearest is looked for, before it is made exact."""


@dataclass(frozen=True)
class Axis:
    """Short stretches of an axis.

    Attributes
    ----------
    spots : (k, 3) float64, mm
    arc : (k,) float64, mm
        Of each along the axis.
    tree : cKDTree
        Of the spots.
    """

    spots: FloatArray
    arc: FloatArray
    tree: cKDTree

    @staticmethod
    def of(points: FloatArray, arc: FloatArray) -> Axis:
        """Of a polyline (p, 3) with arcs (p,), mm."""
        from scipy.spatial import cKDTree  # loads for 0.3 s; few jobs come here

        count = np.maximum(np.ceil(np.diff(arc) / _SPACING_MM), 1).astype(np.int64)
        at, number = split_rows(count)
        share = number / count[at]
        dense = np.append(arc[at] + share * np.diff(arc)[at], arc[-1])
        spots = np.append(points[at] + share[:, None] * np.diff(points, axis=0)[at], points[-1:], 0)
        return Axis(spots, dense, cKDTree(spots))

    def nearest(self, place: FloatArray) -> FloatArray:
        """Arc of what is nearest to each of (n, 3) places, (n,), mm."""
        spots, arc, nearest = self.spots, self.arc, self.tree.query(place)[1]
        best, best_arc = np.full(len(place), np.inf), arc[nearest]
        for side in (-1, 0):
            a = np.clip(nearest + side, 0, len(spots) - 2)
            step = spots[a + 1] - spots[a]
            square = np.maximum((step**2).sum(axis=1), 1e-300)
            t = np.clip(((place - spots[a]) * step).sum(axis=1) / square, 0.0, 1.0)
            gap = np.linalg.norm(spots[a] + t[:, None] * step - place, axis=1)
            best_arc = np.where(gap < best, arc[a] + t * (arc[a + 1] - arc[a]), best_arc)
            best = np.minimum(best, gap)
        return best_arc


class OverlapRules(NamedTuple):
    """Which places of a network count as overlapping."""

    # Two filaments are one body where they reach so far into each other, in radii of the thinner
    # one. Where they only brush each other the needle may as well stay out.
    deep: float = 0.25
    # Of the way along the vessels, the gap between two places: below it the way has turned by more
    # than a right angle, or forks at less. A thick vessel's own way ahead is near, too.
    turn: float = 0.7
    finest_mm: float = 0.05
    coarsest_mm: float = 0.1
    grain_mm: float = 0.05
    # Overlapping places are kept once for each cell of that size along both vessels, as its middle.
    # Cells begin at such a part of one, where no spot of a straight vessel of round length lies.
    grain_from: float = 0.3183


OVERLAP: Final = OverlapRules()


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
    radius_mm : float, mm
        Of the bare shaft.
    """
    spots = _spots(network)
    one, other, gap = _near(spots)
    thin = np.minimum(spots.radius[one], spots.radius[other])
    thick = np.maximum(spots.radius[one], spots.radius[other])
    deep = thin + thick - gap
    reach = np.sqrt(2.0) * (radius_mm + thick) + overlap_radii * thick
    way, joined = _through_nodes(network, spots, one, other, reach)
    deep_enough = (deep >= OVERLAP.deep * thin) & ~joined & (gap < OVERLAP.turn * way)
    pair = np.column_stack([one, other])[deep_enough]
    order = np.argsort(spots.vessel[pair], axis=1, kind="stable")
    pair = np.take_along_axis(pair, order, axis=1)
    return Overlaps(spots.vessel[pair], spots.along[pair], deep[deep_enough], gap[deep_enough])


def _spots(network: WrittenNetwork) -> _Spots:
    """Every vessel cut into stretches of half its least radius."""
    count = np.diff(network.offset)
    finest = np.minimum.reduceat(network.radius, network.offset[:-1]) / 2
    pitch = np.repeat(finest.clip(OVERLAP.finest_mm, OVERLAP.coarsest_mm), count)
    length = np.diff(network.arc, append=0.0)
    length[network.offset[1:] - 1] = 0.0
    parts = np.maximum(np.ceil(length / pitch), 1).astype(np.int64)
    row, number = split_rows(parts)
    share = number / parts[row]
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
    cells = np.floor(overlaps.along / OVERLAP.grain_mm + OVERLAP.grain_from)
    nearest = np.argsort(overlaps.gap, kind="stable")
    keys = np.column_stack([overlaps.vessel, cells])[nearest]
    keys, first = np.unique(keys, axis=0, return_index=True)
    gap = overlaps.gap[nearest[first]]
    u, v, a, b = keys.T
    a, b = ((one + 0.5 - OVERLAP.grain_from) * OVERLAP.grain_mm for one in (a, b))
    forth, back = np.column_stack([u, v, a, b, gap]), np.column_stack([v, u, b, a, gap])
    at_nodes = _at_nodes(network)
    rows = np.concatenate([at_nodes, forth, back])
    wide = np.where(np.arange(len(rows)) < len(at_nodes), 0.0, OVERLAP.grain_mm / 2)
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
