"""Plan branches that dive from trunks into the tissue, clear of all vessels laid so far."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from design.anatomy.trunk_lines import Layer, TrunkLines, join_layer, outward, with_shares
from design.errors import GrowthError
from design.geometry.polyline import arc_lengths, places_along
from design.tissue import Tissue
from design.vasculature.options import GrowthOptions
from kernels.arrays import FloatArray, IntArray


class _Perforators(NamedTuple):
    """How wide perforators are, where they are tried, and how they are laid."""

    # Radius over the root's that a perforator is to stay below: what is wider is a trunk, and
    # belongs below the epicardium. Ours.
    narrow: float = 0.2
    full: float = 0.19  # the same for which one is planned at most: others then part its work
    filled: float = 0.25  # of what one as wide as ``narrow`` feeds, that each is planned for
    least_fed: int = 4  # terminals that one is planned for at least
    few_fed: int = 12  # the same where one that feeds four would be as wide as a trunk already
    places: int = 6000  # of the tissue, between which ways are found
    linked: float = 0.7  # of the depth that a perforator needs, that ways have
    # Of the depth that one needs: way from all vessels below which a place gets no other; and of a
    # place's own such way: places about it that are given up with it where it can't be reached.
    crowded: float = 2.0
    fine: float = 8.0  # places along a perforator for each such distance that it serves
    tried: int = 60  # places of trunks, the nearest first, from which one is tried
    at_once: int = 12  # of them, whose ways are made smooth at once
    wider: float = 1.2  # radius of a trunk over that of what leaves it, at least
    room: float = 1.3  # clear way about one over what radii and clearance ask for
    between: float = 3.0  # way from its beginning within which other vessels are near, over radii
    step: float = 1.0  # of a perforator's radius: distance of compared places
    piece: float = 0.25  # length of straight pieces over the edge of the cube that it serves
    least_pieces: int = 6
    most_pieces: int = 40
    bends: int = 12  # rounds in which it is made smooth


PERFORATORS = _Perforators()


def with_perforators(
    tissue: Tissue,
    lines: TrunkLines,
    radius: FloatArray,
    volume: FloatArray,
    options: GrowthOptions,
) -> tuple[TrunkLines, FloatArray]:
    """Return lines with branches to the places that are farthest from all of them; and all radii.

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
    given, gamma = PERFORATORS, options.murray_exponent
    roots = lines.share[lines.parent < 0]
    root = float(radius.max() / roots.max() ** (1.0 / gamma))
    # Parts of the tissue: what one as wide as a trunk feeds, and what each is planned for.
    narrow = given.narrow**gamma * float(roots.min())
    fed = given.least_fed if options.terminals * narrow > given.least_fed else given.few_fed
    least = fed / options.terminals
    part = max(given.filled * narrow, least)
    near_mm = float(np.cbrt(part * tissue.volume_mm3))
    narrow_mm, piece_mm = root * part ** (1.0 / gamma), given.piece * near_mm
    room = Room(tissue, lines, radius, narrow_mm, options.clearance_mm, piece_mm)
    deep = volume[-tissue.grid.distance(volume) >= room.need_mm][: given.places]
    try:
        ways = Ways(join_layer(tissue, deep, given.linked * room.need_mm), lines.points)
    except GrowthError:
        return lines, radius  # too thin for any
    while (site := int(np.argmax(ways.away))) >= 0 and ways.away[site] > near_mm:
        path = room.path_to(ways, site)
        if path is None:
            ways.leave(site, 0.5 * near_mm)
        else:
            ways.take(pieces_along(path[:-1], path[1:], near_mm / given.fine)[0])
    most = max(given.full**gamma, least / float(roots.min()))
    whole = with_shares(room.lines(), volume)
    while (path := _beside(room, ways, room.served_by_full(whole, ways, most))) is not None:
        ways.take(pieces_along(path[:-1], path[1:], room.need_mm)[0])
        whole = with_shares(room.lines(), volume)
    own = root * whole.share[len(radius) :] ** (1.0 / gamma)
    return whole, np.concatenate([radius, own])


def _beside(room: Room, ways: Ways, sites: IntArray) -> FloatArray | None:
    """Lay a perforator to the farthest of ``sites`` (k,) to which one fits, if any."""
    crowded = PERFORATORS.crowded
    while len(sites := sites[ways.away[sites] > crowded * room.need_mm]):
        site = int(sites[np.argmax(ways.away[sites])])
        path = room.path_to(ways, site)
        if path is not None:
            return path
        ways.leave(site, crowded * ways.away[site])
    return None


class Ways:
    """Places all over the tissue, joined, and the way ``away`` (n,), mm, of each from vessels."""

    def __init__(self, layer: Layer, vessels: FloatArray) -> None:
        """Measure a layer's ways from vessels (k, 3)."""
        self.layer, self.graph = layer, layer.graph(layer.length)
        self.away = np.full(len(layer.points), np.inf)
        self.take(vessels)
        self.away[~np.isfinite(self.away)] = 0.0

    def take(self, vessels: FloatArray) -> None:
        """Let vessels run through places (k, 3)."""
        near = np.unique(cKDTree(self.layer.points).query(vessels)[1])
        self.away = np.minimum(self.away, dijkstra(self.graph, indices=near, min_only=True))

    def leave(self, place: int, near_mm: float) -> None:
        """Give up what is as near to a place."""
        far = np.linalg.norm(self.layer.points - self.layer.points[place], axis=1)
        self.away[far < near_mm] = 0.0


@dataclass
class Room:
    """What is laid so far, and where there is room for more perforators of ``narrow_mm`` radius.

    Trunks' nodes have radii (n,), mm; perforators' ``points`` and parents are numbered on.
    """

    tissue: Tissue
    trunks: TrunkLines
    radius: FloatArray
    narrow_mm: float
    clearance_mm: float
    piece_mm: float  # length of their straight pieces, at about
    points: list[FloatArray] = field(default_factory=list)
    parent: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        lines = self.trunks
        below = np.flatnonzero(lines.parent >= 0)
        begin, end = lines.points[lines.parent[below]], lines.points[below]
        self._places, row = pieces_along(begin, end, PERFORATORS.step * self.narrow_mm)
        self._wide = self.radius[below][row]
        self._index = cKDTree(self._places)
        inlet = lines.parent < 0
        self._free = ~inlet & ~inlet[lines.parent] & (lines.child_count() == 1)
        self._free &= self.radius >= PERFORATORS.wider * self.narrow_mm

    @property
    def need_mm(self) -> float:
        """Depth that a perforator's axis needs."""
        return self.narrow_mm + PERFORATORS.room * self.clearance_mm

    def path_to(self, ways: Ways, site: int) -> FloatArray | None:
        """Return places of a perforator from a trunk to a place, which is laid; None without room.

        It is tried from the nearest places of trunks, some at once.
        """
        given, points = PERFORATORS, ways.layer.points
        way, before = dijkstra(ways.graph, indices=site, return_predecessors=True)
        hop, near = cKDTree(points).query(self.trunks.points)
        cost = np.where(self._free, way[near] + 2.0 * hop, np.inf)
        starts = np.argsort(cost)[: given.tried]
        starts = starts[np.isfinite(cost[starts])]
        pieces = np.ceil(cost[starts[:1]].sum() / self.piece_mm)
        parts = np.linspace(
            0.0, 1.0, int(np.clip(pieces, given.least_pieces, given.most_pieces)) + 1
        )
        for few in np.array_split(starts, range(given.at_once, len(starts), given.at_once)):
            lines = []
            for start in few.tolist():
                line, here = [self.trunks.points[start]], int(near[start])
                while here >= 0:
                    line.append(points[here])
                    here = int(before[here])
                along = arc_lengths(np.array(line))
                lines.append(places_along(np.array(line), along, along[-1] * parts))
            for start, path in zip(few.tolist(), self._smooth(np.array(lines)), strict=True):
                if self._fits(start, path):
                    self._lay(start, path)
                    return path
        return None

    def _smooth(self, paths: FloatArray) -> FloatArray:
        """Smooth paths (k, n, 3), as far from the surface as they need if they can be."""
        for _ in range(PERFORATORS.bends if paths.size else 0):
            paths[:, 1:-1] = 0.5 * paths[:, 1:-1] + 0.25 * (paths[:, :-2] + paths[:, 2:])
            inner = paths[:, 1:-1].reshape(-1, 3)
            lack = np.maximum(self.need_mm + self.tissue.grid.distance(inner), 0.0)
            inner = inner - 1.1 * lack[:, None] * outward(self.tissue, inner)
            paths[:, 1:-1] = inner.reshape(paths[:, 1:-1].shape)
        return paths

    def _fits(self, start: int, path: FloatArray) -> bool:
        """Return whether a perforator is in the tissue, clear of all but what it begins beside."""
        given = PERFORATORS
        places, _ = pieces_along(path[:-1], path[1:], given.step * self.narrow_mm)
        begin, near = np.linalg.norm(places - path[0], axis=1), float(self.radius[start])
        deep = -self.tissue.grid.distance(places[begin > near])
        if not len(deep) or (deep < self.need_mm).any():
            return False
        own = given.between * (near + self.narrow_mm)
        far = places[begin > own]
        reach = given.room * (self.narrow_mm + float(self._wide.max()) + self.clearance_mm)
        beside = np.unique(np.concatenate([[], *self._index.query_ball_point(far, reach)]))
        others = beside.astype(np.int64)
        others = others[np.linalg.norm(self._places[others] - path[0], axis=1) > own]
        if not len(others):
            return True
        gap = cKDTree(far).query(self._places[others])[0]
        clear = given.room * (self.narrow_mm + self._wide[others] + self.clearance_mm)
        return bool((gap > clear).all())

    def _lay(self, start: int, path: FloatArray) -> None:
        """Lay a perforator, so that no other begins just beside it."""
        first = len(self.trunks.parent) + len(self.points)
        self.parent += [start, *range(first, first + len(path) - 2)]
        self.points += list(path[1:])
        places, _ = pieces_along(path[:-1], path[1:], PERFORATORS.step * self.narrow_mm)
        self._places = np.concatenate([self._places, places])
        self._wide = np.concatenate([self._wide, np.full(len(places), self.narrow_mm)])
        self._index = cKDTree(self._places)
        beside = np.linalg.norm(self.trunks.points - path[0], axis=1)
        self._free[beside < PERFORATORS.between * self.narrow_mm] = False

    def served_by_full(self, lines: TrunkLines, ways: Ways, most: float) -> IntArray:
        """Return places of ways nearest to a perforator that feeds more than ``most``.

        Of its tree's share; ``lines`` are `lines`, with shares.
        """
        own = len(self.trunks.parent)
        root = lines.parent < 0
        whole = np.zeros(int(lines.tree.max()) + 1)
        whole[lines.tree[root]] = lines.share[root]
        full = np.zeros(len(lines.parent), dtype=np.bool_)
        for i in range(own, len(full)):
            above = int(lines.parent[i])
            begins = above < own and lines.share[i] > most * whole[lines.tree[i]]
            full[i] = begins or full[above]
        return np.flatnonzero(full[cKDTree(lines.points).query(ways.layer.points)[1]])

    def lines(self) -> TrunkLines:
        """Return trunks and perforators, these last; shares aren't measured."""
        own = self.trunks
        tree = list(own.tree)
        for above in self.parent:
            tree.append(tree[above])
        points = np.concatenate([own.points, np.array(self.points).reshape(-1, 3)])
        parent = np.concatenate([own.parent, np.array(self.parent, dtype=np.int64)])
        return TrunkLines(points, parent, np.array(tree, dtype=np.int64), np.zeros(len(parent)))


def pieces_along(begin: FloatArray, end: FloatArray, step_mm: float) -> tuple[FloatArray, IntArray]:
    """Return places (k, 3) along pieces, so far apart at most, and each one's piece."""
    count = np.ceil(np.linalg.norm(end - begin, axis=1) / step_mm).astype(np.int64) + 1
    row = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    part = (number / np.maximum(count - 1, 1)[row])[:, None]
    return begin[row] + part * (end - begin)[row], row
