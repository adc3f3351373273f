"""Lay a connecting vessel between each pair of matched terminals; retry those that failed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.vasculature.growth.index import CellIndex, empty_index, insert
from design.vasculature.loops.curves import (
    CAPSULE,
    KIN,
    PIECES,
    Ends,
    Rule,
    best_curve,
    radius_for,
    weigh,
)
from design.vasculature.loops.routes import RouteObstacles, find_route
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii
from kernels import jit
from kernels.arrays import FloatArray, IntArray

FIRST = 24
"""Shapes all weighed for every connection."""
SHAPES = 600
"""Shapes tried in all where the first don't fit."""
NEAR = 32
"""Connections nearby that are exchanged or laid anew to make way."""
ROUNDS = 4
"""Times all that failed are tried again."""
DRAWN_BACK = (0.2, 0.4, 0.6)
"""Parts of a terminal's length by which it is shortened where nothing else makes way."""
FEW, PART = 4, 0.25
"""Failures, or part of all connections, up to which ways round are searched and terminals
shortened: where more fail, the trees don't suit each other."""
STUB = 4.0
"""Room kept in front of a terminal until it is joined, over a connection's radius."""
_SKETCH = 5
"""Points of each curve by which near ones are found."""


@dataclass(frozen=True)
class RemovedConnection:
    """A connection as it was, so that it can be put back."""

    partner: int
    curve: FloatArray
    radius: float
    routed: bool


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
    drawn_back : (n,) float64, mm
        By how much it was shortened since.
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
    drawn_back: FloatArray
    mixing: bool = False

    def draw_back(self, tip: int, by: float) -> None:
        """Shorten a terminal's vessel by ``by`` (mm; negative gives back)."""
        self.point[tip] -= by * self.direction[tip]
        self.way[tip, 1:] -= by
        self.drawn_back[tip] += by

    def lost(self, tip: int) -> float:
        """Length over r⁴ that a terminal has lost, mm⁻³."""
        return float(self.drawn_back[tip] / self.radius[tip] ** 4)

    def towards(self, tip: int, place: FloatArray) -> FloatArray:
        """Unit vectors (k, 3) in which a connection to ``place`` may leave, the best first."""
        ahead: FloatArray = self.direction[tip]
        if not self.mixing:
            return ahead[None]
        way = place - self.point[tip]
        sideways = way - (way @ ahead) * ahead
        size = float(np.linalg.norm(sideways))
        if size < 1e-9 * float(np.linalg.norm(way)):
            sideways = np.cross(ahead, np.eye(3)[np.argmin(np.abs(ahead))])
            size = float(np.linalg.norm(sideways))
        turn = np.radians(_TURNS)[:, None]
        ways: FloatArray = (
            np.cos(turn) * sideways / size + np.sin(turn) * np.cross(ahead, sideways) / size
        )
        return ways


@dataclass
class Web:
    """Set of connections under construction.

    Attributes
    ----------
    one, other : Tips
    partner : (n,) int64
        Which of ``other`` each of ``one`` is to be joined to.
    rule : Rule
    bounds : (2, 3) float64, mm
        Of the tissue.
    capsules : (k + 2 n + ...,) CAPSULE
        The vessels there are, a stub in front of each end not yet joined (those of ``one``, then
        those of ``other``), then places for the connections' pieces.
    fixed : int
        k.
    shapes : (SHAPES, 8) float64
    index : CellIndex
    curve : list of n (m, 3) float64, mm
        Polylines; none where no curve was laid.
    radius : (n,) float64, mm
        0 where no curve was laid.
    routed : (n,) bool
        Not a single cubic.
    """

    one: Tips
    other: Tips
    partner: IntArray
    rule: Rule
    bounds: FloatArray
    capsules: NDArray[np.void]
    fixed: int
    shapes: FloatArray
    index: CellIndex
    curve: list[FloatArray] = field(init=False)
    radius: FloatArray = field(init=False)
    routed: NDArray[np.bool_] = field(init=False)
    sketch: FloatArray = field(init=False)
    place: IntArray = field(init=False)
    room: IntArray = field(init=False)

    def __post_init__(self) -> None:
        count = len(self.partner)
        self.curve = [np.empty((0, 3))] * count
        self.radius, self.routed = np.zeros(count), np.zeros(count, dtype=bool)
        self.sketch = np.zeros((count, _SKETCH, 3))
        self.place = self.fixed + 2 * count + PIECES * np.arange(count, dtype=np.int64)
        self.room = np.full(count, PIECES)

    @property
    def failed(self) -> IntArray:
        """Connections without a curve."""
        return np.flatnonzero(self.radius == 0)

    @property
    def shortened(self) -> int:
        """Terminals that were drawn back."""
        return int((self.one.drawn_back > 0).sum() + (self.other.drawn_back > 0).sum())

    def lay_all(self) -> None:
        """Lay every connection, the shortest first; then mend until nothing gets better."""
        chord = self.one.point - self.other.point[self.partner]
        for number in np.argsort(np.linalg.norm(chord, axis=1), kind="stable"):
            self.lay(int(number))
        for _ in range(ROUNDS):
            before = len(self.failed)
            for number in self.failed:
                if self.radius[number] == 0:
                    self._mend(int(number))
            if len(self.failed) in (0, before):
                break
        for way in (self._route, self._draw_back):
            if len(self.failed) > max(FEW, PART * len(self.partner)):
                return
            for number in self.failed:
                if self.radius[number] == 0:
                    way(int(number))

    def lay(self, number: int) -> bool:
        """Lay one connection as a single cubic; False when no shape fits."""
        self._stubs(number, 0)
        points = np.empty((PIECES + 1, 3))
        radius, pieces = self._best(number, len(self.capsules), points)
        if radius > 0:
            self._stand(number, points[: pieces + 1], radius, routed=False)
        else:
            self._stubs(number, 1)
        return bool(radius > 0)

    def _best(self, number: int, until: int, points: FloatArray) -> tuple[float, int]:
        for ends in self._ends(number):
            best: tuple[float, int] = best_curve(
                ends, self.shapes, FIRST, self.rule, self.index, self.capsules, until, points
            )
            if best[0] > 0:
                break
        return best

    def _route(self, number: int) -> bool:
        """Lay one connection by a way round; False when there is none."""
        self._stubs(number, 0)
        crowd = RouteObstacles(self.rule, self.index, self.capsules, self.bounds)
        for ends in self._ends(number):
            route = find_route(ends, crowd)
            if route is not None:
                self._stand(number, route.points, route.radius, routed=True)
                return True
        self._stubs(number, 1)
        return False

    def _stubs(self, number: int, there: int) -> None:
        """Keep room in front of a connection's ends, or don't."""
        self.capsules["there"][self.fixed + number] = there
        if not self.other.mixing:
            second = self.fixed + len(self.partner) + self.partner[number]
            self.capsules["there"][second] = there

    def _ends(self, number: int) -> list[Ends]:
        """What a connection begins and ends at; several where its direction is free."""
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

    def may_be(self, number: int, points: FloatArray) -> bool:
        """Whether a laid connection fits as another polyline too."""
        self.capsules["there"][self._pieces(number)] = 0
        cost, _ = weigh(
            self._ends(number)[0],
            points,
            np.inf,
            self.rule,
            self.index,
            self.capsules,
            len(self.capsules),
            np.inf,
        )
        self.capsules["there"][self._pieces(number)] = 1
        return bool(cost < np.inf)

    def alter(self, number: int, points: FloatArray) -> None:
        """Give a laid connection another polyline, and the radius that goes with its length."""
        length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        radius = radius_for(length, self._ends(number)[0], self.rule)
        routed = bool(self.routed[number])
        self._fell(number)
        self._stand(number, points, radius, routed=routed)

    def _pieces(self, number: int) -> slice:
        """Where a connection's pieces are among the capsules, as many as it has."""
        first = int(self.place[number])
        return slice(first, first + max(len(self.curve[number]) - 1, 0))

    def _stand(self, number: int, points: FloatArray, radius: float, *, routed: bool) -> None:
        """Put a connection's pieces among the vessels."""
        pieces = len(points) - 1
        if pieces > self.room[number]:
            self._find_room(number, pieces)
        self.curve[number] = points.copy()
        self.radius[number], self.routed[number] = radius, routed
        at = np.linspace(0, pieces, _SKETCH).astype(np.int64)
        self.sketch[number] = points[at]
        where = self._pieces(number)
        fill_capsules(self.capsules[where], points[:-1], points[1:], np.full(pieces, radius))
        self._stubs(number, 0)
        if not list_some(self.capsules, where.start, where.stop, self.index):
            self.reindex()

    def _find_room(self, number: int, pieces: int) -> None:
        """Give a connection places behind all others."""
        self.place[number], self.room[number] = len(self.capsules), pieces
        self.capsules = np.concatenate([self.capsules, empty_capsules(pieces)])
        self.reindex()

    def _fell(self, number: int) -> None:
        self.capsules["there"][self._pieces(number)] = 0
        self.curve[number], self.radius[number] = np.empty((0, 3)), 0.0
        self.routed[number] = False
        self._stubs(number, 1)

    def reindex(self) -> None:
        """List everything anew, with twice the room where it is short."""
        room = max(len(self.index.item), 2 * int(self.index.used[0]))
        low = self.index.origin
        bounds = np.array([low, low + self.index.shape * self.index.cell])
        while True:
            self.index = empty_index(bounds, self.index.cell, room, len(self.capsules))
            if list_some(self.capsules, 0, len(self.capsules), self.index):
                return
            room *= 2

    def _draw_back(self, number: int) -> None:
        """Make room in front of a connection's terminals by shortening them."""
        choices = ((0,),) if self.other.mixing else ((0,), (1,), (0, 1))
        for part in DRAWN_BACK:
            for sides in choices:
                ends = [
                    (self.one, number) if side == 0 else (self.other, int(self.partner[number]))
                    for side in sides
                ]
                for tips, tip in ends:
                    self._shorten(tips, tip, part * tips.length[tip] - tips.drawn_back[tip])
                if self.lay(number) or self._route(number) or self._mend(number):
                    return
                for tips, tip in ends:
                    self._shorten(tips, tip, -tips.drawn_back[tip])

    def _shorten(self, tips: Tips, tip: int, by: float) -> None:
        tips.draw_back(tip, by)
        item = tips.kin[tip, 0]
        for axis, name in enumerate(("dx", "dy", "dz")):
            self.capsules[name][item] = tips.point[tip, axis]

    def _mend(self, number: int) -> bool:
        """Make way for a connection: lay a neighbour anew after it, or exchange partners."""
        tips = (self.one.point[number], self.other.point[self.partner[number]])
        ends = np.stack([self.one.point, self.other.point[self.partner]], axis=1)
        places = np.where((self.radius > 0)[:, None, None], self.sketch, ends[:, :1])
        away = np.min([((places - tip) ** 2).sum(axis=2).min(axis=1) for tip in tips], axis=0)
        away[number] = np.inf
        # Where the vessels that stay are in the way, laying neighbours anew is no help.
        self._stubs(number, 0)
        alone = self._best(number, self.fixed, np.empty((PIECES + 1, 3)))[0] > 0
        self._stubs(number, 1)
        for other in np.argsort(away, kind="stable")[: min(NEAR, len(away) - 1)]:
            for exchange in (False, True) if alone else (True,):
                if self._both(number, int(other), exchange):
                    return True
        return False

    def _both(self, number: int, other: int, exchange: bool) -> bool:
        """Lay two connections anew, or leave both as they were and return False."""
        pair = (number, other)
        before = [self._laid(n) for n in pair]
        for n in pair:
            self._fell(n)
        if exchange:
            self.partner[[number, other]] = self.partner[[other, number]]
        if self.lay(number) and (self.lay(other) or before[1].radius == 0):
            return True
        for n in pair:
            self._fell(n)
        for n, was in zip(pair, before, strict=True):
            self.partner[n] = was.partner
        for n, was in zip(pair, before, strict=True):
            if was.radius > 0:
                self._stand(n, was.curve, was.radius, routed=was.routed)
        return False

    def _laid(self, number: int) -> RemovedConnection:
        return RemovedConnection(
            int(self.partner[number]),
            self.curve[number],
            float(self.radius[number]),
            bool(self.routed[number]),
        )


def curve_shapes(seed: int, kink: float) -> FloatArray:
    """Numbers that shape the candidates, (SHAPES, 8): see `design.vasculature.loops.curves.handle`.

    The first are symmetrical, without anything sideways; the others leave their terminals in
    random directions within the angle ``kink``, radians, of them.
    """
    plain = [
        (reach, lean, 0.0, 0.0, reach, lean, 0.0, 0.0)
        for reach in (0.15, 0.3, 0.45, 0.6, 0.8, 1.1)
        for lean in (0.0, 0.25, 0.5, 0.75)
    ]
    random = np.random.default_rng(seed)
    size = (SHAPES - len(plain), 2)
    short, long = random.uniform(0.02, 0.4, size), random.uniform(0.2, 1.6, size)
    reach = np.where(random.uniform(size=size) < 0.4, short, long)
    side = np.tan(random.uniform(0.0, 0.999 * kink, size))
    turn = random.uniform(0.0, 2.0 * np.pi, size)
    drawn = np.stack([reach, 0.0 * reach, side * np.cos(turn), side * np.sin(turn)], axis=-1)
    return np.concatenate([np.array(plain), drawn.reshape(len(drawn), 8)])


@jit
def list_some(capsules: Any, first: int, end: int, index: CellIndex) -> bool:
    """List capsules with a radius, from ``first`` to ``end``; False when out of room."""
    for i in range(first, end):
        s = capsules[i]
        if s.radius > 0.0 and not insert(index, i, s, s.radius):
            return False
    return True


def empty_capsules(count: int) -> NDArray[np.void]:
    """Room for so many capsules, none there yet."""
    return np.zeros(count, CAPSULE)


def fill_capsules(
    capsules: NDArray[np.void], start: FloatArray, end: FloatArray, radius: FloatArray
) -> None:
    """Set ends (n, 3) and radii (n,), mm, and let them stand."""
    for axis, names in enumerate((("px", "dx"), ("py", "dy"), ("pz", "dz"))):
        capsules[names[0]], capsules[names[1]] = start[:, axis], end[:, axis]
    capsules["radius"], capsules["there"] = radius, 1


# Terminals that connecting vessels may start from: end point, directions, shortening so far.

_TURNS = np.array([0.0, 60.0, -60.0, 120.0, -120.0, 180.0])
"""Around a connection, from the direction in which the other end lies, degrees."""


def tree_tips(tree: VesselTree, first: int) -> Tips:
    """The terminals of a tree whose segments are numbered from ``first`` on."""
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
    """The other child of each parent, -1 where there is no parent."""
    other = tree.children[parent].sum(axis=1) - segment
    return np.where(parent >= 0, other, -1).astype(np.int64)


def join_tips(tips: Sequence[Tips]) -> Tips:
    """The tips of several trees as one side."""
    names = [f.name for f in fields(Tips) if f.name != "mixing"]
    columns: dict[str, Any] = {n: np.concatenate([getattr(t, n) for t in tips]) for n in names}
    return Tips(**columns)
