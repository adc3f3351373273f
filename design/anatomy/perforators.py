"""Plan branches that dive from a heart's epicardial trunks into its septum and thick walls."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from design.anatomy.layer import Layer, join_layer
from design.anatomy.trunk_lines import TrunkLines, outward, with_shares
from design.errors import GrowthError
from design.geometry.polyline import arc_lengths, places_along
from design.tissue import Tissue
from design.vasculature.options import GrowthOptions
from kernels.arrays import FloatArray, IntArray

NARROW: Final = 0.2
"""Radius over the root's that a perforator is to stay below: what is wider is a trunk, and belongs
below the epicardium. Ours."""

_FILLED: Final = 0.25
"""Of what a perforator as wide as that feeds: part that each is planned for. Those that get more
than their share stay below it, then."""

_TRIED: Final = 60
"""Places of trunks, the nearest first, from which a perforator is tried."""

_WIDER: Final = 1.2
"""Radius of a trunk over that of what leaves it, at least."""

_ROOM: Final = 1.3
"""Clear way about a perforator over what radii and clearance ask for."""

_BETWEEN: Final = 3.0
"""Way between two perforators' beginnings, and from its own within which a trunk is near, over
their radii."""

_STEP: Final = 1.0
"""Of a perforator's radius: places of vessels that are compared lie so far apart."""

_PIECES, _BENDS = 6, 12
"""Straight pieces of a perforator, and rounds in which it is made smooth."""

_LINKED: Final = 0.7
"""Of the depth that a perforator needs, what ways have between their places."""

_PLACES: Final = 6000
"""Of the tissue, between which ways are found."""

_FINE: Final = 8.0
"""Places along a perforator for each such distance that it serves."""

_LEAST_FED: Final = 12
"""Terminals that a perforator is planned for at least."""


def with_perforators(
    tissue: Tissue,
    lines: TrunkLines,
    radius: FloatArray,
    volume: FloatArray,
    options: GrowthOptions,
) -> tuple[TrunkLines, FloatArray]:
    """The lines with branches to the places that are farthest from all of them; and all radii.

    Each leaves a trunk by itself and feeds a small part, as septal perforators do, so that none is
    as wide as a trunk. There are as many as bring all tissue as near as the edge of a cube that
    one is planned for.

    Parameters
    ----------
    lines, radius : TrunkLines, (n,) float64, mm
        Trunks, laid.
    volume : (k, 3) float64, mm
        Points all over the tissue.
    """
    power = 1.0 / options.murray_exponent
    roots = lines.share[lines.parent < 0]
    root = float(radius.max() / roots.max() ** power)
    part = _FILLED * NARROW**options.murray_exponent * float(roots.min())
    part = max(part, _LEAST_FED / options.terminals)
    near_mm = float(np.cbrt(part * tissue.volume_mm3))
    room = _Room(tissue, lines, radius, root * part**power, options.clearance_mm)
    deep = volume[-tissue.grid.distance(volume) >= room.need_mm]
    try:
        ways = _Ways.through(tissue, deep[:_PLACES], _LINKED * room.need_mm, lines.points)
    except GrowthError:
        return lines, radius  # too thin for any
    while (site := int(np.argmax(ways.away))) >= 0 and ways.away[site] > near_mm:
        path = room.path_to(ways, site)
        if path is None:
            ways.leave(site, 0.5 * near_mm)
        else:
            ways.take(_along(path[:-1], path[1:], near_mm / _FINE)[0])
    whole = with_shares(room.lines(), volume)
    own = root * whole.share[len(radius) :] ** power
    return whole, np.concatenate([radius, own])


@dataclass
class _Ways:
    """Places all over the tissue, and ways from one to the next that don't leave it.

    Attributes
    ----------
    layer : Layer
        The places with their links.
    away : (n,) float64, mm
        Way of each from the nearest vessel.
    """

    layer: Layer
    away: FloatArray
    _graph: csr_matrix

    @staticmethod
    def through(tissue: Tissue, places: FloatArray, depth_mm: float, vessels: FloatArray) -> _Ways:
        """Places of a tissue, at least so deep, their ways from vessels (k, 3) measured.

        Raises
        ------
        GrowthError
            When too few hang together.
        """
        layer = join_layer(tissue, places, depth_mm)
        graph = csr_matrix((layer.length, layer.to, layer.first), shape=(len(layer.points),) * 2)
        ways = _Ways(layer, np.full(len(layer.points), np.inf), graph)
        ways.take(vessels)
        ways.away[~np.isfinite(ways.away)] = 0.0
        return ways

    def take(self, vessels: FloatArray) -> None:
        """Let vessels run through places (k, 3)."""
        near = np.unique(cKDTree(self.layer.points).query(vessels)[1])
        far = dijkstra(self._graph, indices=near, min_only=True)
        self.away = np.minimum(self.away, far)

    def leave(self, place: int, near_mm: float) -> None:
        """Give up what is as near to a place."""
        far = np.linalg.norm(self.layer.points - self.layer.points[place], axis=1)
        self.away[far < near_mm] = 0.0

    def from_place(self, place: int) -> tuple[FloatArray, IntArray]:
        """Way (n,), mm, of all from one, and the place before each on it."""
        way, before = dijkstra(self._graph, indices=place, return_predecessors=True)
        return way, before


@dataclass
class _Room:
    """What is laid so far, and where there is room for more."""

    tissue: Tissue
    trunks: TrunkLines
    radius: FloatArray
    narrow_mm: float
    clearance_mm: float
    points: list[FloatArray] = field(default_factory=list)
    parent: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        lines = self.trunks
        below = np.flatnonzero(lines.parent >= 0)
        begin, end = lines.points[lines.parent[below]], lines.points[below]
        self._places, row = _along(begin, end, _STEP * self.narrow_mm)
        self._wide = self.radius[below][row]
        inlet = lines.parent < 0
        self._free = ~inlet & ~inlet[np.maximum(lines.parent, 0)] & (lines.child_count() == 1)
        self._free &= self.radius >= _WIDER * self.narrow_mm

    @property
    def need_mm(self) -> float:
        """Depth that a perforator's axis needs."""
        return self.narrow_mm + _ROOM * self.clearance_mm

    def path_to(self, ways: _Ways, site: int) -> FloatArray | None:
        """Places of a perforator from a trunk to a place, which is laid; None without room."""
        points = ways.layer.points
        way, before = ways.from_place(site)
        hop, near = cKDTree(points).query(self.trunks.points)
        cost = np.where(self._free, way[near] + 2.0 * hop, np.inf)
        for start in np.argsort(cost)[:_TRIED].tolist():
            if np.isfinite(cost[start]):
                line = [self.trunks.points[start]]
                here = int(near[start])
                while here != site:
                    line.append(points[here])
                    here = int(before[here])
                path = self._smooth(np.array([*line, points[site]]))
                if self._fits(start, path):
                    self._lay(start, path)
                    return path
        return None

    def _smooth(self, line: FloatArray) -> FloatArray:
        """A line in a few pieces, made smooth, as far from the surface as it needs if it can be."""
        way = arc_lengths(line)
        path = places_along(line, way, np.linspace(0.0, way[-1], _PIECES + 1))
        for _ in range(_BENDS):
            path[1:-1] = 0.5 * path[1:-1] + 0.25 * (path[:-2] + path[2:])
            lack = np.maximum(self.need_mm + self.tissue.grid.distance(path[1:-1]), 0.0)
            path[1:-1] -= 1.1 * lack[:, None] * outward(self.tissue, path[1:-1])
        return path

    def _fits(self, start: int, path: FloatArray) -> bool:
        """Whether a perforator lies in the tissue, clear of all that it doesn't begin beside."""
        places, _ = _along(path[:-1], path[1:], _STEP * self.narrow_mm)
        begin, near = np.linalg.norm(places - path[0], axis=1), float(self.radius[start])
        deep = -self.tissue.grid.distance(places[begin > near])
        if not len(deep) or (deep < self.need_mm).any():
            return False
        own = _BETWEEN * (near + self.narrow_mm)
        others = np.linalg.norm(self._places - path[0], axis=1) > own
        far = places[begin > own]
        if not len(far):
            return True
        gap = cKDTree(far).query(self._places[others])[0]
        clear = _ROOM * (self.narrow_mm + self._wide[others] + self.clearance_mm)
        return bool((gap > clear).all())

    def _lay(self, start: int, path: FloatArray) -> None:
        """Lay a perforator, so that no other begins just beside it."""
        first = len(self.trunks.parent) + len(self.points)
        self.parent += [start, *range(first, first + len(path) - 2)]
        self.points += list(path[1:])
        places, _ = _along(path[:-1], path[1:], _STEP * self.narrow_mm)
        self._places = np.concatenate([self._places, places])
        self._wide = np.concatenate([self._wide, np.full(len(places), self.narrow_mm)])
        beside = np.linalg.norm(self.trunks.points - path[0], axis=1)
        self._free[beside < _BETWEEN * self.narrow_mm] = False

    def lines(self) -> TrunkLines:
        """Trunks and perforators, these last; shares aren't measured."""
        own = self.trunks
        tree = list(own.tree)
        for above in self.parent:
            tree.append(tree[above])
        points = np.concatenate([own.points, np.array(self.points).reshape(-1, 3)])
        parent = np.concatenate([own.parent, np.array(self.parent, dtype=np.int64)])
        return TrunkLines(points, parent, np.array(tree, dtype=np.int64), np.zeros(len(parent)))


def _along(begin: FloatArray, end: FloatArray, step_mm: float) -> tuple[FloatArray, IntArray]:
    """Places (k, 3) along pieces, so far apart at most, and each one's piece."""
    count = np.ceil(np.linalg.norm(end - begin, axis=1) / step_mm).astype(np.int64) + 1
    row = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    part = (number / np.maximum(count - 1, 1)[row])[:, None]
    return begin[row] + part * (end - begin)[row], row
