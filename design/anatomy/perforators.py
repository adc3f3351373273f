"""Plan branches that dive from trunks into the tissue, clear of all vessels laid so far."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from design.anatomy.trunk_lines import Layer, TrunkLines, join_layer, outward, with_shares
from design.errors import GrowthError
from design.geometry.polyline import arc_lengths, places_along
from design.tissue import Tissue
from design.vasculature.options import GrowthOptions
from kernels.arrays import BoolArray, FloatArray, IntArray

NARROW: Final = 0.2
"""Radius over the root's that a perforator is to stay below: what is wider is a trunk, and belongs
below the epicardium. Ours."""
_FULL: Final = 0.19
"""Radius over its root's that a perforator may be planned for at most: others then part its work.
A little below `NARROW`, as growth spreads terminals a little differently."""
_FILLED: Final = 0.25
"""Of what a perforator as wide as that feeds: part that each is planned for. Those that get more
than their share stay below it, then."""
_PIECE: Final = 0.25
"""Of the edge of the cube that a perforator serves: such pieces follow a thin wall's bends."""
_CROWDED: Final = 2.0
"""Way of a place from all vessels, over the depth that a perforator needs, below which it gets no
other; and ways about a place that can't be reached which are given up with it, over its own."""
_LINKED: Final = 0.7
"""Of the depth that a perforator needs, what ways have between their places."""
_PLACES: Final = 6000
"""Of the tissue, between which ways are found."""
_FINE: Final = 8.0
"""Places along a perforator for each such distance that it serves."""
_LEAST_FED, _FEW_FED = 4, 12
"""Terminals that a perforator is planned for at least; and where one that feeds four would be as
wide as a trunk already, so that there are too few terminals for narrow ones."""


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
    one is planned for; and beside those that feed too much for that, as many more as find room.

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
    narrow = NARROW**options.murray_exponent * float(roots.min())
    least = (
        _LEAST_FED if options.terminals * narrow > _LEAST_FED else _FEW_FED
    ) / options.terminals
    part = max(_FILLED * narrow, least)
    near_mm = float(np.cbrt(part * tissue.volume_mm3))
    room = Room(tissue, lines, radius, root * part**power, options.clearance_mm, _PIECE * near_mm)
    deep = volume[-tissue.grid.distance(volume) >= room.need_mm]
    try:
        ways = Ways.through(tissue, deep[:_PLACES], _LINKED * room.need_mm, lines.points)
    except GrowthError:
        return lines, radius  # too thin for any
    while (site := int(np.argmax(ways.away))) >= 0 and ways.away[site] > near_mm:
        path = room.path_to(ways, site)
        if path is None:
            ways.leave(site, 0.5 * near_mm)
        else:
            ways.take(pieces_along(path[:-1], path[1:], near_mm / _FINE)[0])
    most = max(_FULL**options.murray_exponent, least / float(roots.min()))
    whole = _parted(room, ways, volume, most)
    own = root * whole.share[len(radius) :] ** power
    return whole, np.concatenate([radius, own])


def _parted(room: Room, ways: Ways, volume: FloatArray, most: float) -> TrunkLines:
    """Lines with more perforators beside those that feed too much; shares are measured.

    Parameters
    ----------
    most : float
        Of its tree's share, that a perforator is to feed at most.
    """
    while True:
        whole = with_shares(room.lines(), volume)
        path = _beside(room, ways, np.flatnonzero(room.served_by_full(whole, ways, most)))
        if path is None:
            return whole
        ways.take(pieces_along(path[:-1], path[1:], room.need_mm)[0])


def _beside(room: Room, ways: Ways, sites: IntArray) -> FloatArray | None:
    """A perforator that is laid to the farthest of ``sites`` (k,) to which one fits, if any."""
    while len(sites := sites[ways.away[sites] > _CROWDED * room.need_mm]):
        site = int(sites[np.argmax(ways.away[sites])])
        path = room.path_to(ways, site)
        if path is not None:
            return path
        ways.leave(site, _CROWDED * ways.away[site])
    return None


# Find ways for branches through a tissue from trunks, clear of all vessels laid so far.

_TRIED: Final = 60
"""Places of trunks, the nearest first, from which a perforator is tried."""
_WIDER: Final = 1.2
"""Radius of a trunk over that of what leaves it, at least."""
_ROOM: Final = 1.3
"""Clear way about a perforator over what radii and clearance ask for."""
_BETWEEN: Final = 3.0
"""Way between two perforators' beginnings, and from its own within which a trunk is near, over
their radii."""
_AT_ONCE: Final = 12
"""Ways that are made smooth at once."""
_STEP: Final = 1.0
"""Of a perforator's radius: places of vessels that are compared lie so far apart."""
_PIECES, _BENDS = (6, 40), 12
"""Straight pieces of a perforator, at least and at most, and rounds in which it is made smooth."""


@dataclass
class Ways:
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
    def through(tissue: Tissue, places: FloatArray, depth_mm: float, vessels: FloatArray) -> Ways:
        """Places of a tissue, at least so deep, their ways from vessels (k, 3) measured.

        Raises
        ------
        GrowthError
            When too few hang together.
        """
        layer = join_layer(tissue, places, depth_mm)
        graph = csr_matrix((layer.length, layer.to, layer.first), shape=(len(layer.points),) * 2)
        ways = Ways(layer, np.full(len(layer.points), np.inf), graph)
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
class Room:
    """What is laid so far, and where there is room for more.

    Attributes
    ----------
    tissue : Tissue
    trunks : TrunkLines
    radius : (n,) float64, mm
        Of the trunks' nodes.
    narrow_mm : float
        Radius of a perforator.
    clearance_mm : float
    piece_mm : float
        Length of its straight pieces, at about.
    points, parent : list
        Its nodes and their parents, numbered on after the trunks'.
    """

    tissue: Tissue
    trunks: TrunkLines
    radius: FloatArray
    narrow_mm: float
    clearance_mm: float
    piece_mm: float
    points: list[FloatArray] = field(default_factory=list)
    parent: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        lines = self.trunks
        below = np.flatnonzero(lines.parent >= 0)
        begin, end = lines.points[lines.parent[below]], lines.points[below]
        self._places, row = pieces_along(begin, end, _STEP * self.narrow_mm)
        self._wide = self.radius[below][row]
        self._index = cKDTree(self._places)
        inlet = lines.parent < 0
        self._free = ~inlet & ~inlet[np.maximum(lines.parent, 0)] & (lines.child_count() == 1)
        self._free &= self.radius >= _WIDER * self.narrow_mm

    @property
    def need_mm(self) -> float:
        """Depth that a perforator's axis needs."""
        return self.narrow_mm + _ROOM * self.clearance_mm

    def path_to(self, ways: Ways, site: int) -> FloatArray | None:
        """Places of a perforator from a trunk to a place, which is laid; None without room."""
        points = ways.layer.points
        way, before = ways.from_place(site)
        hop, near = cKDTree(points).query(self.trunks.points)
        cost = np.where(self._free, way[near] + 2.0 * hop, np.inf)
        starts = np.argsort(cost)[:_TRIED]
        starts = starts[np.isfinite(cost[starts])]
        pieces = int(np.clip(np.ceil(cost[starts[:1]].sum() / self.piece_mm), *_PIECES))
        for few in np.array_split(starts, range(_AT_ONCE, len(starts), _AT_ONCE)):
            lines = [
                self._line(points, start, int(near[start]), before, pieces)
                for start in few.tolist()
            ]
            for start, path in zip(few.tolist(), self._smooth(np.array(lines)), strict=True):
                if self._fits(start, path):
                    self._lay(start, path)
                    return path
        return None

    def _line(
        self, points: FloatArray, start: int, here: int, before: IntArray, pieces: int
    ) -> FloatArray:
        """A line from a trunk's node by the places before each other, in a few pieces."""
        line = [self.trunks.points[start]]
        while here >= 0:
            line.append(points[here])
            here = int(before[here])
        way = arc_lengths(np.array(line))
        return places_along(np.array(line), way, np.linspace(0.0, way[-1], pieces + 1))

    def _smooth(self, paths: FloatArray) -> FloatArray:
        """Paths (k, n, 3) made smooth, as far from the surface as they need if they can be."""
        for _ in range(_BENDS if paths.size else 0):
            paths[:, 1:-1] = 0.5 * paths[:, 1:-1] + 0.25 * (paths[:, :-2] + paths[:, 2:])
            inner = paths[:, 1:-1].reshape(-1, 3)
            lack = np.maximum(self.need_mm + self.tissue.grid.distance(inner), 0.0)
            inner = inner - 1.1 * lack[:, None] * outward(self.tissue, inner)
            paths[:, 1:-1] = inner.reshape(paths[:, 1:-1].shape)
        return paths

    def _fits(self, start: int, path: FloatArray) -> bool:
        """Whether a perforator lies in the tissue, clear of all that it doesn't begin beside."""
        places, _ = pieces_along(path[:-1], path[1:], _STEP * self.narrow_mm)
        begin, near = np.linalg.norm(places - path[0], axis=1), float(self.radius[start])
        deep = -self.tissue.grid.distance(places[begin > near])
        if not len(deep) or (deep < self.need_mm).any():
            return False
        own = _BETWEEN * (near + self.narrow_mm)
        far = places[begin > own]
        reach = _ROOM * (self.narrow_mm + float(self._wide.max()) + self.clearance_mm)
        beside = np.unique(np.concatenate([[], *self._index.query_ball_point(far, reach)]))
        others = beside.astype(np.int64)
        others = others[np.linalg.norm(self._places[others] - path[0], axis=1) > own]
        if not len(others):
            return True
        gap = cKDTree(far).query(self._places[others])[0]
        clear = _ROOM * (self.narrow_mm + self._wide[others] + self.clearance_mm)
        return bool((gap > clear).all())

    def _lay(self, start: int, path: FloatArray) -> None:
        """Lay a perforator, so that no other begins just beside it."""
        first = len(self.trunks.parent) + len(self.points)
        self.parent += [start, *range(first, first + len(path) - 2)]
        self.points += list(path[1:])
        places, _ = pieces_along(path[:-1], path[1:], _STEP * self.narrow_mm)
        self._places = np.concatenate([self._places, places])
        self._wide = np.concatenate([self._wide, np.full(len(places), self.narrow_mm)])
        self._index = cKDTree(self._places)
        beside = np.linalg.norm(self.trunks.points - path[0], axis=1)
        self._free[beside < _BETWEEN * self.narrow_mm] = False

    def served_by_full(self, lines: TrunkLines, ways: Ways, most: float) -> BoolArray:
        """Which places (n,) of ways are nearest to a perforator that feeds more than ``most``.

        Of its tree's share; ``lines`` are `lines`, with shares.
        """
        own = len(self.trunks.parent)
        root = np.flatnonzero(lines.parent < 0)
        whole = np.zeros(int(lines.tree.max()) + 1)
        whole[lines.tree[root]] = lines.share[root]
        full = np.zeros(len(lines.parent), dtype=np.bool_)
        for i in range(own, len(full)):
            above = int(lines.parent[i])
            begins = above < own and lines.share[i] > most * whole[lines.tree[i]]
            full[i] = begins or full[above]
        return np.asarray(full[cKDTree(lines.points).query(ways.layer.points)[1]])

    def lines(self) -> TrunkLines:
        """Trunks and perforators, these last; shares aren't measured."""
        own = self.trunks
        tree = list(own.tree)
        for above in self.parent:
            tree.append(tree[above])
        points = np.concatenate([own.points, np.array(self.points).reshape(-1, 3)])
        parent = np.concatenate([own.parent, np.array(self.parent, dtype=np.int64)])
        return TrunkLines(points, parent, np.array(tree, dtype=np.int64), np.zeros(len(parent)))


def pieces_along(begin: FloatArray, end: FloatArray, step_mm: float) -> tuple[FloatArray, IntArray]:
    """Places (k, 3) along pieces, so far apart at most, and each one's piece."""
    count = np.ceil(np.linalg.norm(end - begin, axis=1) / step_mm).astype(np.int64) + 1
    row = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    part = (number / np.maximum(count - 1, 1)[row])[:, None]
    return begin[row] + part * (end - begin)[row], row
