"""Connect matched terminals by cubic curves, partners exchanged if blocked, or by ways round."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.vasculature.growth.kernels.index import CellIndex, empty_index, insert
from design.vasculature.loops.curves import (
    CAPSULE,
    CURVE,
    KIN,
    ConnectionLimits,
    Ends,
    best_curve,
    polyline_cost,
    radius_for,
)
from design.vasculature.loops.routes import RouteObstacles, find_route
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii
from kernels import jit
from kernels.arrays import FloatArray, IntArray


class ConnectionSearch(NamedTuple):
    """How thoroughly connections are searched for."""

    first_shapes: int = 24
    """Shapes of a curve that are all weighed."""
    shapes: int = 600
    """Shapes tried at most where none of these fits."""
    neighbours: int = 32
    """Nearest connections with which partners are exchanged."""
    rounds: int = 4
    """Passes over all pairs that are blocked."""
    few: int = 4
    part: float = 0.25
    """Blocked pairs, or part of all pairs, up to which ways round are searched: where more are
    blocked, the trees don't suit each other."""
    shortened: tuple[float, float, float, float] = (0.0, 0.2, 0.4, 0.6)
    """Parts of their length by which blocked terminals are shortened, in turn."""
    free_length: float = 4.0
    """Length kept clear in front of a terminal until it is joined, over a connection's radius."""
    sketch_points: int = 5
    """Points of each curve by which near ones are found."""


SEARCH = ConnectionSearch()
SIDEWAYS_DEGREES = (0.0, 60.0, -60.0, 120.0, -120.0, 180.0)
"""Directions around a mixing node's connection, from that in which the other end lies."""
PLACES = CURVE.pieces + 1
"""Capsules of a connection: a mixing node may add one to a curve's pieces."""


@dataclass(frozen=True)
class Tips:
    """Terminals of one side, arterial or venous.

    Attributes
    ----------
    point, direction : (n, 3) float64
        mm, and unit vectors.
    kin : (n, KIN) int64
        See `Ends`.
    way : (n, KIN) float64, mm
    length, radius : (n,) float64, mm
        Of the terminal's vessel as grown.
    shortened : (n,) float64, mm
        By how much.
    mixing : bool
        Ends on other connections: their directions are those connections' own, which a new one
        leaves sideways.
    """

    point: FloatArray
    direction: FloatArray
    kin: IntArray
    way: FloatArray
    length: FloatArray
    radius: FloatArray
    shortened: FloatArray
    mixing: bool = False

    def shorten(self, tip: int, by: float) -> None:
        """Shorten a terminal's vessel by ``by`` (mm; negative gives back)."""
        self.point[tip] -= by * self.direction[tip]
        self.way[tip, 1:] -= by
        self.shortened[tip] += by

    def lost(self, tip: int) -> float:
        """Return the length over r⁴ that a terminal has lost, mm⁻³."""
        return float(self.shortened[tip] / self.radius[tip] ** 4)

    def towards(self, tip: int, place: FloatArray) -> FloatArray:
        """Return unit vectors (k, 3) along which a connection to ``place`` may leave, in order."""
        ahead: FloatArray = self.direction[tip]
        if not self.mixing:
            return ahead[None]
        way = place - self.point[tip]
        sideways = way - (way @ ahead) * ahead
        size = float(np.linalg.norm(sideways))
        if size < 1e-9 * float(np.linalg.norm(way)):
            sideways = np.cross(ahead, np.eye(3)[np.argmin(np.abs(ahead))])
            size = float(np.linalg.norm(sideways))
        turn = np.radians(SIDEWAYS_DEGREES)[:, None]
        ways: FloatArray = (
            np.cos(turn) * sideways / size + np.sin(turn) * np.cross(ahead, sideways) / size
        )
        return ways


@dataclass
class Connections:
    """Connections between two sides' terminals under construction.

    Attributes
    ----------
    one, other : Tips
    partner : (n,) int64
        Which of ``other`` each of ``one`` is to be joined to.
    limits : ConnectionLimits
    bounds : (2, 3) float64, mm
        Of the tissue.
    capsules : (k + 2 n + ...,) CAPSULE
        The vessels that stay, a stub in front of each end not yet joined (those of ``one``, then
        those of ``other``), then the connections' pieces: of each `PLACES`, or behind all others
        where it has more.
    fixed : int
        k.
    shapes : (m, 8) float64
    index : CellIndex
    curve : list of n (m, 3) float64, mm
        Polylines; empty where a pair isn't joined.
    radius : (n,) float64, mm
        0 where a pair isn't joined.
    """

    one: Tips
    other: Tips
    partner: IntArray
    limits: ConnectionLimits
    bounds: FloatArray
    capsules: NDArray[np.void]
    fixed: int
    shapes: FloatArray
    index: CellIndex
    curve: list[FloatArray] = field(init=False)
    radius: FloatArray = field(init=False)
    sketch: FloatArray = field(init=False)
    first: IntArray = field(init=False)

    def __post_init__(self) -> None:
        count = len(self.partner)
        self.curve = [np.empty((0, 3))] * count
        self.radius = np.zeros(count)
        self.first = self.fixed + 2 * count + PLACES * np.arange(count, dtype=np.int64)
        self.sketch = np.zeros((count, SEARCH.sketch_points, 3))

    @property
    def blocked(self) -> IntArray:
        """Pairs without a connection."""
        return np.flatnonzero(self.radius == 0)

    @property
    def shortened(self) -> int:
        """Number of terminals that were shortened."""
        return int((self.one.shortened > 0).sum() + (self.other.shortened > 0).sum())

    def join_all(self) -> None:
        """Join every pair, the nearest first; then free those that are blocked.

        At first by exchanging partners, in rounds until nothing gets better; then by ways round,
        where few are left.
        """
        chord = self.one.point - self.other.point[self.partner]
        for number in np.argsort(np.linalg.norm(chord, axis=1), kind="stable"):
            self.join(int(number))
        before = -1
        for _ in range(SEARCH.rounds):
            if len(self.blocked) in (0, before):
                break
            before = len(self.blocked)
            for number in self.blocked:
                if self.radius[number] == 0:
                    self._exchange_partners(int(number))
        if len(self.blocked) > max(SEARCH.few, SEARCH.part * len(self.partner)):
            return
        for part in SEARCH.shortened:
            for number in self.blocked:
                if self.radius[number] == 0:
                    self._reroute(int(number), part)

    def join(self, number: int) -> bool:
        """Join one pair by a cubic curve; False when no shape fits."""
        self._set_stubs(number, 0)
        points = np.empty((CURVE.pieces + 1, 3))
        for ends in self._ends(number):
            radius, pieces = best_curve(
                ends,
                self.shapes,
                SEARCH.first_shapes,
                self.limits,
                self.index,
                self.capsules,
                points,
            )
            if radius > 0:
                self.add(number, points[: pieces + 1], radius)
                return True
        self._set_stubs(number, 1)
        return False

    def add(self, number: int, points: FloatArray, radius: float) -> None:
        """Place a connection's pieces among the vessels."""
        pieces = len(points) - 1
        if pieces > PLACES:
            self.first[number] = len(self.capsules)
            self.capsules = np.concatenate([self.capsules, empty_capsules(pieces)])
            self.reindex()
        self.curve[number], self.radius[number] = points.copy(), radius
        at = np.linspace(0, pieces, SEARCH.sketch_points).astype(np.int64)
        self.sketch[number] = points[at]
        where = self._pieces(number)
        fill_capsules(self.capsules[where], points[:-1], points[1:], np.full(pieces, radius))
        self._set_stubs(number, 0)
        if not list_capsules(self.capsules, where.start, where.stop, self.index):
            self.reindex()

    def remove(self, number: int) -> None:
        """Take a connection away."""
        self.capsules["present"][self._pieces(number)] = 0
        self.curve[number], self.radius[number] = np.empty((0, 3)), 0.0
        self._set_stubs(number, 1)

    def fits(self, number: int, points: FloatArray) -> bool:
        """Return whether a connection may have another polyline."""
        self.capsules["present"][self._pieces(number)] = 0
        ends = self._ends(number)[0]
        cost, _ = polyline_cost(
            ends, points, np.inf, self.limits, self.index, self.capsules, np.inf
        )
        self.capsules["present"][self._pieces(number)] = 1
        return bool(cost < np.inf)

    def alter(self, number: int, points: FloatArray) -> None:
        """Give a connection another polyline, and the radius that goes with its length."""
        length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        radius = radius_for(length, self._ends(number)[0], self.limits)
        self.remove(number)
        self.add(number, points, radius)

    def reindex(self) -> None:
        """List everything anew, with twice the entries where they are short."""
        entries = max(len(self.index.item), 2 * int(self.index.used[0]))
        low = self.index.origin
        bounds = np.array([low, low + self.index.shape * self.index.cell])
        while True:
            self.index = empty_index(bounds, self.index.cell, entries, len(self.capsules))
            if list_capsules(self.capsules, 0, len(self.capsules), self.index):
                return
            entries *= 2

    def _set_stubs(self, number: int, present: int) -> None:
        """Keep the space in front of a pair's ends clear, or don't."""
        self.capsules["present"][self.fixed + number] = present
        if not self.other.mixing:
            second = self.fixed + len(self.partner) + self.partner[number]
            self.capsules["present"][second] = present

    def _ends(self, number: int) -> list[Ends]:
        """Return the ends of a connection; several where its direction is free."""
        one, other, b = self.one, self.other, int(self.partner[number])
        here, there = one.point[number], other.point[b]
        return [
            Ends(
                np.stack([here, there]),
                np.stack([one.direction[number], ahead]),
                np.array([one.radius[number], other.radius[b]]),
                np.stack([one.kin[number], other.kin[b]]),
                np.stack([one.way[number], other.way[b]]),
                one.lost(number) + other.lost(b),
            )
            for ahead in other.towards(b, here)
        ]

    def _pieces(self, number: int) -> slice:
        """Return where a connection's pieces are among the capsules."""
        first = int(self.first[number])
        return slice(first, first + max(len(self.curve[number]) - 1, 0))

    def _exchange_partners(self, number: int) -> bool:
        """Join a blocked pair by exchanging partners with a neighbour; False if none will do."""
        tips = (self.one.point[number], self.other.point[self.partner[number]])
        places = np.where((self.radius > 0)[:, None, None], self.sketch, self.one.point[:, None])
        away = np.min([((places - tip) ** 2).sum(axis=2).min(axis=1) for tip in tips], axis=0)
        away[number] = np.inf
        nearest = np.argsort(away, kind="stable")[: min(SEARCH.neighbours, len(away) - 1)]
        return any(self._exchange(number, int(neighbour)) for neighbour in nearest)

    def _exchange(self, number: int, neighbour: int) -> bool:
        """Exchange two pairs' partners and join both, or leave both as they were."""
        pair = [number, neighbour]
        before = [(self.curve[n], float(self.radius[n])) for n in pair]
        for n in pair:
            self.remove(n)
        self.partner[pair] = self.partner[pair[::-1]]
        if self.join(number) and (self.join(neighbour) or before[1][1] == 0):
            return True
        for n in pair:
            self.remove(n)
        self.partner[pair] = self.partner[pair[::-1]]
        for n, (curve, radius) in zip(pair, before, strict=True):
            if radius > 0:
                self.add(n, curve, radius)
        return False

    def _reroute(self, number: int, part: float) -> bool:
        """Join a blocked pair by a way round, its terminals shortened by ``part``, one or both."""
        one, other = (self.one, number), (self.other, int(self.partner[number]))
        if part == 0.0:
            return self._route(number)
        for ends in [[one]] if self.other.mixing else [[one], [other], [one, other]]:
            for tips, tip in ends:
                self._shorten(tips, tip, part * tips.length[tip] - tips.shortened[tip])
            if self.join(number) or self._route(number) or self._exchange_partners(number):
                return True
            for tips, tip in ends:
                self._shorten(tips, tip, -tips.shortened[tip])
        return False

    def _route(self, number: int) -> bool:
        """Join one pair by a way round other vessels; False when none is found."""
        self._set_stubs(number, 0)
        obstacles = RouteObstacles(self.limits, self.index, self.capsules, self.bounds)
        for ends in self._ends(number):
            route = find_route(ends, obstacles)
            if route is not None:
                self.add(number, route.points, route.radius)
                return True
        self._set_stubs(number, 1)
        return False

    def _shorten(self, tips: Tips, tip: int, by: float) -> None:
        tips.shorten(tip, by)
        item = tips.kin[tip, 0]
        for axis, name in enumerate(("dx", "dy", "dz")):
            self.capsules[name][item] = tips.point[tip, axis]


def curve_shapes(seed: int, kink: float) -> FloatArray:
    """Return numbers that shape the candidates, (m, 8): see `loops.curves.handle`.

    The first are symmetrical, without anything sideways; the others leave their terminals in
    random directions within the angle ``kink``, radians, of them.
    """
    plain = [
        (reach, lean, 0.0, 0.0, reach, lean, 0.0, 0.0)
        for reach in (0.15, 0.3, 0.45, 0.6, 0.8, 1.1)
        for lean in (0.0, 0.25, 0.5, 0.75)
    ]
    random = np.random.default_rng(seed)
    size = (SEARCH.shapes - len(plain), 2)
    short, long = random.uniform(0.02, 0.4, size), random.uniform(0.2, 1.6, size)
    reach = np.where(random.uniform(size=size) < 0.4, short, long)
    side = np.tan(random.uniform(0.0, 0.999 * kink, size))
    turn = random.uniform(0.0, 2.0 * np.pi, size)
    drawn = np.stack([reach, 0.0 * reach, side * np.cos(turn), side * np.sin(turn)], axis=-1)
    return np.concatenate([np.array(plain), drawn.reshape(len(drawn), 8)])


@jit
def list_capsules(capsules: Any, first: int, end: int, index: CellIndex) -> bool:
    """List capsules with a radius, from ``first`` to ``end``; False when the index is full."""
    for i in range(first, end):
        s = capsules[i]
        if s.radius > 0.0 and not insert(index, i, s, s.radius):
            return False
    return True


def empty_capsules(count: int) -> NDArray[np.void]:
    """Return so many capsules, none present yet."""
    return np.zeros(count, CAPSULE)


def fill_capsules(
    capsules: NDArray[np.void], start: FloatArray, end: FloatArray, radius: FloatArray
) -> None:
    """Set ends (n, 3) and radii (n,), mm, and mark the capsules present."""
    for axis, names in enumerate((("px", "dx"), ("py", "dy"), ("pz", "dz"))):
        capsules[names[0]], capsules[names[1]] = start[:, axis], end[:, axis]
    capsules["radius"], capsules["present"] = radius, 1


def tree_tips(tree: VesselTree, first: int) -> Tips:
    """Return the terminals of a tree whose segments are numbered from ``first`` on."""
    tip = np.flatnonzero(tree.children[:, 0] < 0)
    span = tree.distal[tip] - tree.proximal[tip]
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    parent = tree.parent[tip].astype(np.int64)
    above = np.where(parent >= 0, tree.parent[parent], -1).astype(np.int64)
    kin = np.full((len(tip), KIN), -1, dtype=np.int64)
    way = np.zeros((len(tip), KIN))
    kin[:, 0] = tip
    kin[:, 1], kin[:, 2] = parent, _sibling(tree, tip, parent)
    kin[:, 3] = above
    kin[:, 4] = np.where(parent >= 0, _sibling(tree, parent, above), -1)
    way[:, 1:3] = length[tip, None]
    way[:, 3:] = (length[tip] + length[parent])[:, None]
    return Tips(
        tree.distal[tip],
        span / length[tip, None],
        np.where(kin >= 0, kin + first, -1),
        way,
        length[tip],
        tree_radii(tree)[tip],
        np.zeros(len(tip)),
    )


def _sibling(tree: VesselTree, segment: IntArray, parent: IntArray) -> IntArray:
    """Return the other child of each parent, -1 where there is no parent."""
    other = tree.children[parent].sum(axis=1) - segment
    return np.where(parent >= 0, other, -1).astype(np.int64)


def join_tips(tips: Sequence[Tips]) -> Tips:
    """Return the tips of several trees as one side."""
    names = [f.name for f in fields(Tips) if f.name != "mixing"]
    columns: dict[str, Any] = {n: np.concatenate([getattr(t, n) for t in tips]) for n in names}
    return Tips(**columns)
