"""Lay curves between matched terminals one after another, and mend what found no way."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.vasculature.curves import CAPSULE, PIECES, Ends, Rule, best_curve
from design.vasculature.index import CellIndex, empty_index, insert
from kernels import jit

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

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

FEW, FEW_PART = 4, 0.01
"""Failures, or part of all connections, up to which terminals are shortened: where more fail,
the trees don't suit each other."""

STUB = 4.0
"""Room kept in front of a terminal until it is joined, over a connection's radius."""


@dataclass(frozen=True)
class Tips:
    """The terminals of one side.

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
    """

    point: FloatArray
    direction: FloatArray
    kin: IntArray
    way: FloatArray
    length: FloatArray
    radius: FloatArray
    drawn_back: FloatArray

    def draw_back(self, tip: int, by: float) -> None:
        """Shorten a terminal's vessel by ``by`` (mm; negative gives back)."""
        self.point[tip] -= by * self.direction[tip]
        self.way[tip, 1:] -= by
        self.drawn_back[tip] += by

    def lost(self, tip: int) -> float:
        """Length over r⁴ that a terminal has lost, mm⁻³."""
        return float(self.drawn_back[tip] / self.radius[tip] ** 4)


@dataclass
class Web:
    """Connections while they are laid.

    Attributes
    ----------
    one, other : Tips
    partner : (n,) int64
        Which of ``other`` each of ``one`` is to be joined to.
    rule : Rule
    capsules : (k + 2 n + n PIECES,) CAPSULE
        The trees' vessels, a stub in front of each terminal not yet joined (those of ``one``,
        then those of ``other``), then a place for each connection's pieces.
    trees : int
        k.
    shapes : (SHAPES, 8) float64
    index : CellIndex
    curve : (n, PIECES + 1, 3) float64, mm
    radius : (n,) float64, mm
        0 where no curve was laid.
    """

    one: Tips
    other: Tips
    partner: IntArray
    rule: Rule
    capsules: NDArray[np.void]
    trees: int
    shapes: FloatArray
    index: CellIndex
    curve: FloatArray = field(init=False)
    radius: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.curve = np.zeros((len(self.partner), PIECES + 1, 3))
        self.radius = np.zeros(len(self.partner))

    @property
    def failed(self) -> IntArray:
        """Connections without a curve."""
        return np.flatnonzero(self.radius == 0)

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
        if len(self.failed) > max(FEW, FEW_PART * len(self.partner)):
            return
        for number in self.failed:
            if self.radius[number] == 0:
                self._draw_back(int(number))

    def lay(self, number: int) -> bool:
        """Lay one connection; False when no shape fits."""
        self._stubs(number, 0)
        radius = best_curve(
            self._ends(number),
            self.shapes,
            FIRST,
            self.rule,
            self.index,
            self.capsules,
            self.curve[number],
        )
        self.radius[number] = radius
        if radius > 0:
            self._stand(number)
        else:
            self._stubs(number, 1)
        return bool(radius > 0)

    def _stubs(self, number: int, there: int) -> None:
        """Keep room in front of a connection's terminals, or don't."""
        first = self.trees + np.array([number, len(self.partner) + self.partner[number]])
        self.capsules["there"][first] = there

    def _ends(self, number: int) -> Ends:
        one, other, b = self.one, self.other, self.partner[number]
        return Ends(
            np.stack([one.point[number], other.point[b]]),
            np.stack([one.direction[number], other.direction[b]]),
            np.stack([one.kin[number], other.kin[b]]),
            np.stack([one.way[number], other.way[b]]),
            one.lost(number) + other.lost(b),
        )

    def _places(self, number: int) -> slice:
        first = self.trees + 2 * len(self.partner) + number * PIECES
        return slice(first, first + PIECES)

    def _stand(self, number: int) -> None:
        """Put a connection's pieces among the vessels."""
        where = self._places(number)
        points, radius = self.curve[number], np.full(PIECES, self.radius[number])
        fill_capsules(self.capsules[where], points[:-1], points[1:], radius)
        self._stubs(number, 0)
        if not list_some(self.capsules, where.start, where.stop, self.index):
            self.reindex()

    def _fell(self, number: int) -> None:
        self.capsules["there"][self._places(number)] = 0
        self.radius[number] = 0.0
        self._stubs(number, 1)

    def reindex(self) -> None:
        """List everything anew, with twice the room."""
        room = 2 * len(self.index.item)
        low = self.index.origin
        bounds = np.array([low, low + self.index.shape * self.index.cell])
        self.index = empty_index(bounds, self.index.cell, room, len(self.capsules))
        if not list_some(self.capsules, 0, len(self.capsules), self.index):
            self.reindex()

    def _draw_back(self, number: int) -> None:
        """Make room in front of a connection's terminals by shortening them."""
        for part in DRAWN_BACK:
            for sides in ((0,), (1,), (0, 1)):
                ends = [
                    (self.one, number) if side == 0 else (self.other, int(self.partner[number]))
                    for side in sides
                ]
                for tips, tip in ends:
                    self._shorten(tips, tip, part * tips.length[tip] - tips.drawn_back[tip])
                if self.lay(number) or self._mend(number):
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
        places = np.where((self.radius > 0)[:, None, None], self.curve, ends[:, :1])
        away = np.min([((places - tip) ** 2).sum(axis=2).min(axis=1) for tip in tips], axis=0)
        away[number] = np.inf
        for other in np.argsort(away, kind="stable")[:NEAR]:
            for exchange in (False, True):
                if self._both(number, int(other), exchange):
                    return True
        return False

    def _both(self, number: int, other: int, exchange: bool) -> bool:
        """Lay two connections anew, or leave both as they were and return False."""
        pair = [number, other]
        curve, radius = self.curve[pair].copy(), self.radius[pair].copy()
        before = self.partner[pair].copy()
        self._fell(number)
        self._fell(other)
        if exchange:
            self.partner[pair] = before[::-1]
        if self.lay(number) and (self.lay(other) or radius[1] == 0):
            return True
        self._fell(number)
        self._fell(other)
        self.partner[pair], self.curve[pair], self.radius[pair] = before, curve, radius
        for one in pair:
            if self.radius[one] > 0:
                self._stand(one)
        return False


def curve_shapes(seed: int, kink: float) -> FloatArray:
    """Numbers that shape the candidates, (SHAPES, 8): see `design.vasculature.curves.handle`.

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
