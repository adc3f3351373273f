"""Judge mends by painted voxels and sampled needles, from G-code text alone, without product code.

A line of a layer hangs below the tip, h high, with round sides: A = (w - h) h + π h²/4. A filament
is round, A = π r². What is missing is cut out of the moves before they are painted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.read_gcode import Moves, read_moves

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

EXCUSED_RADII = 0.5


@dataclass(frozen=True)
class Ink:
    """Straight pieces of ink (n, 3) to (n, 3), mm, ``area`` (n,), mm², ``move`` that laid each."""

    start: FloatArray
    end: FloatArray
    area: FloatArray
    move: IntArray

    def where(self, rows: BoolArray) -> Ink:
        """Pieces of a mask."""
        return Ink(self.start[rows], self.end[rows], self.area[rows], self.move[rows])

    def near(self, low: FloatArray, high: FloatArray) -> Ink:
        """Pieces whose axes reach into a box."""
        below = np.minimum(self.start, self.end) <= high
        above = np.maximum(self.start, self.end) >= low
        return self.where(np.asarray((below & above).all(axis=1)))


@dataclass(frozen=True)
class Stroke:
    """Written path of the job: its moves, and the way before each point, (k + 1,), mm."""

    moves: IntArray
    arc: FloatArray

    @property
    def length(self) -> float:
        """Whole way, mm."""
        return float(self.arc[-1])


def written(moves: Moves) -> BoolArray:
    """Moves that push while they go, (n,)."""
    return (moves.pushed > 0) & (moves.length > 1e-6)


def ink_of(moves: Moves, ul_per_e: float) -> Ink:
    """All ink that moves lay."""
    rows = np.flatnonzero(written(moves))
    area = moves.pushed[rows] * ul_per_e / moves.length[rows]
    return Ink(moves.start[rows], moves.end[rows], area, rows)


def strokes_of(moves: Moves) -> list[Stroke]:
    """Paths without a way between their moves that doesn't write."""
    wrote, way = written(moves), moves.length
    found: list[Stroke] = []
    current: list[int] = []
    for k in range(len(way)):
        if wrote[k]:
            current.append(k)
        elif way[k] > 1e-6 and current:
            found.append(_stroke(current, way))
            current = []
    return [*found, _stroke(current, way)] if current else found


def _stroke(moves: list[int], way: FloatArray) -> Stroke:
    rows = np.array(moves)
    return Stroke(rows, np.concatenate([[0.0], np.cumsum(way[rows])]))


def place_on(stroke: Stroke, moves: Moves, at: float) -> FloatArray:
    """Place at a way along a stroke, (3,), mm."""
    k = int(np.clip(np.searchsorted(stroke.arc, at) - 1, 0, len(stroke.moves) - 1))
    share = (at - stroke.arc[k]) / (stroke.arc[k + 1] - stroke.arc[k])
    row = stroke.moves[k]
    return np.asarray(moves.start[row] + share * (moves.end[row] - moves.start[row]))


def parted(ink: Ink, stroke: Stroke, gap: tuple[float, float]) -> tuple[Ink, Ink]:
    """Return what is there, and what is missing in a gap: from, to along a stroke, mm."""
    kept: list[tuple[FloatArray, FloatArray, float, int]] = []
    lost: list[tuple[FloatArray, FloatArray, float, int]] = []
    for k, row in enumerate(stroke.moves):
        a, b = stroke.arc[k], stroke.arc[k + 1]
        piece = int(np.flatnonzero(ink.move == row)[0])
        step = ink.end[piece] - ink.start[piece]
        cuts = sorted({a, b, *(min(max(at, a), b) for at in gap)})
        for one, other in pairwise(cuts):
            ends = [ink.start[piece] + step * (at - a) / (b - a) for at in (one, other)]
            missing = gap[0] <= (one + other) / 2 <= gap[1]
            own = (ends[0], ends[1], float(ink.area[piece]), int(row))
            (lost if missing else kept).append(own)
    rest = ink.where(~np.isin(ink.move, stroke.moves))
    return joined(rest, _ink(kept)), _ink(lost)


def _ink(rows: list[tuple[FloatArray, FloatArray, float, int]]) -> Ink:
    if not rows:
        return Ink(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int64))
    start, end, area, move = zip(*rows, strict=True)
    return Ink(np.array(start), np.array(end), np.array(area), np.array(move))


def joined(one: Ink, other: Ink) -> Ink:
    """Both."""
    return Ink(*(np.concatenate([vars(each)[k] for each in (one, other)]) for k in vars(one)))


@dataclass(frozen=True)
class Grid:
    """Voxel centres of a box: ``low`` (3,), ``count`` (3,), edge, mm."""

    low: FloatArray
    count: IntArray
    edge: float

    @staticmethod
    def around(places: FloatArray, margin: float, edge: float) -> Grid:
        """Box of places (n, 3) and a margin."""
        low, high = places.min(axis=0) - margin, places.max(axis=0) + margin
        return Grid(low, np.ceil((high - low) / edge).astype(np.int64) + 1, edge)

    def paint(self, ink: Ink, layer_mm: float | None) -> BoolArray:
        """Voxels in which ink lies; lines of so high a layer, or filaments (None)."""
        out = np.zeros(tuple(self.count), dtype=bool)
        wide = 1.0 + math.sqrt(float(ink.area.max(initial=0.0)))
        ink = ink.near(self.low - wide, self.low + self.count * self.edge + wide)
        for a, b, area in zip(ink.start, ink.end, ink.area, strict=True):
            self._piece(out, a, b, float(area), layer_mm)
        return out

    def _piece(
        self, out: BoolArray, a: FloatArray, b: FloatArray, area: float, layer: float | None
    ) -> None:
        wide = math.sqrt(area / math.pi) if layer is None else _half_width(area, layer)
        reach = np.array([wide, wide, wide if layer is None else layer])
        first = np.floor((np.minimum(a, b) - reach - self.low) / self.edge).astype(int)
        last = np.ceil((np.maximum(a, b) + reach - self.low) / self.edge).astype(int) + 1
        first, last = np.maximum(first, 0), np.minimum(last, self.count)
        if (first >= last).any():
            return
        axes = [self.low[k] + self.edge * np.arange(first[k], last[k]) for k in range(3)]
        x, y, z = np.meshgrid(*axes, indexing="ij")
        box = out[first[0] : last[0], first[1] : last[1], first[2] : last[2]]
        box |= _inside(np.stack([x, y, z], axis=-1), a, b, wide, layer)

    def places(self, mask: BoolArray) -> FloatArray:
        """Centres of a mask's voxels, (n, 3), mm."""
        return self.low + self.edge * np.argwhere(mask)


def _half_width(area: float, layer: float) -> float:
    return max((area - math.pi / 4 * layer**2) / layer + layer, 1e-3) / 2


def _inside(
    places: FloatArray, a: FloatArray, b: FloatArray, wide: float, layer: float | None
) -> BoolArray:
    axes = 3 if layer is None else 2
    step = (b - a)[:axes]
    square = max(float(step @ step), 1e-18)
    share = np.clip(((places[..., :axes] - a[:axes]) @ step) / square, 0, 1)
    away = np.linalg.norm(places[..., :axes] - a[:axes] - share[..., None] * step, axis=-1)
    if layer is None:
        return np.asarray(away <= wide)
    off = places[..., 2] - (a[2] - layer / 2)
    side = np.sqrt(np.maximum(layer**2 / 4 - off**2, 0.0))
    return np.asarray((np.abs(off) <= layer / 2) & (away <= wide - layer / 2 + side))


@dataclass(frozen=True)
class Judged:
    """One mend.

    ``covered``: share of the missing voxels that ink fills after it, 1 where other ink lies there
    anyway; ``in_lumen_mm``: deepest ink of the mend within a lumen; ``beside_mm``: farthest from
    where the sound job has ink; ``crossed``: moves that take the needle through ink; ``off_mm``:
    between place and plunger's count at the insert's end, and at its begin.
    """

    covered: float
    in_lumen_mm: float
    beside_mm: float
    crossed: int
    off_mm: float


@dataclass(frozen=True)
class Case:
    """A held job with a gap: its ``lines`` so far, the ``insert``, where the tip stood at first.

    ``layer_mm`` is None for filaments; ``needle_mm``: outer diameter; ``edge_mm`` of voxels.
    """

    lines: list[str]
    insert: list[str]
    begin_mm: tuple[float, float, float]
    ul_per_e: float
    layer_mm: float | None
    needle_mm: float
    edge_mm: float


def judge(
    case: Case,
    stroke: Stroke,
    gap: tuple[float, float],
    lumens: tuple[FloatArray, FloatArray, FloatArray],
) -> Judged:
    """Judge an insert; ``lumens`` are starts, ends (n, 3) and radii (n, 2) of open tubes."""
    before = read_moves("\n".join(case.lines), case.begin_mm)
    whole = read_moves("\n".join([*case.lines, *case.insert]), case.begin_mm)
    count, layer = len(before.end), case.layer_mm
    ink = ink_of(whole, case.ul_per_e)
    job, mend = ink.where(ink.move < count), ink.where(ink.move >= count)
    there, missing = parted(job, stroke, gap)
    ends = np.concatenate([end for one in (missing, mend) for end in (one.start, one.end)])
    wide = math.sqrt(float(job.area.max())) + (layer or 0.0)
    grid = Grid.around(ends, wide + 2 * case.edge_mm, case.edge_mm)
    sound, left, new, lost = (grid.paint(one, layer) for one in (job, there, mend, missing))
    bare = sound & ~left & lost
    return Judged(
        float((new & bare).sum() / bare.sum()) if bare.any() else 1.0,
        _depth(grid.places(new), lumens),
        _beside(grid, new & ~sound, sound),
        _crossed(whole, count, there, mend, case),
        _off(before, whole, case),
    )


def _off(before: Moves, whole: Moves, case: Case) -> float:
    moved = float(np.abs(whole.end[-1] - before.end[-1]).max())
    counts = [_e_at(lines) for lines in (case.lines, [*case.lines, *case.insert])]
    return max(moved, abs(counts[1] - counts[0]))


def _e_at(lines: list[str]) -> float:
    for line in reversed(lines):
        for word in line.split(";")[0].split()[1:]:
            if word[0] == "E" and line[:3] in ("G0 ", "G1 ", "G92"):
                return float(word[1:])
    return 0.0


def _depth(places: FloatArray, lumens: tuple[FloatArray, FloatArray, FloatArray]) -> float:
    """Deepest of places in tubes, mm; 0 outside."""
    deepest = 0.0
    if not len(places):
        return deepest
    for a, b, (r0, r1) in zip(*lumens, strict=True):
        low, high = np.minimum(a, b) - max(r0, r1), np.maximum(a, b) + max(r0, r1)
        near = places[((places >= low) & (places <= high)).all(axis=1)]
        if len(near):
            step = b - a
            share = np.clip((near - a) @ step / max(float(step @ step), 1e-18), 0, 1)
            away = np.linalg.norm(near - a - share[:, None] * step, axis=1)
            deepest = max(deepest, float((r0 + share * (r1 - r0) - away).max()))
    return deepest


def _beside(grid: Grid, odd: BoolArray, sound: BoolArray) -> float:
    """Farthest of voxels from sound ones, mm, looked for within ten edges."""
    reached, steps = sound.copy(), 0
    while (odd & ~reached).any() and steps < 10:
        grown = reached.copy()
        for axis in range(3):
            for way in (1, -1):
                grown |= np.roll(reached, way, axis)
        reached, steps = grown, steps + 1
    return steps * grid.edge


def _crossed(moves: Moves, first: int, there: Ink, mend: Ink, case: Case) -> int:
    """Moves of the insert on which the needle's cylinder meets ink beyond its joint."""
    ways = np.concatenate([moves.start[first:], moves.end[first:]])
    low, high = ways.min(axis=0), ways.max(axis=0)
    low[:2] -= case.needle_mm + 2.0
    high[:2] += case.needle_mm + 2.0
    high[2] = np.inf  # the shaft stands above the tip
    low[2] -= 2.0
    ink = joined(there, mend).near(low, high)
    if not len(ink.move):
        return 0
    ball, radius, which = _balls(ink, case.layer_mm)
    shaft, crossed = case.needle_mm / 2, 0
    held = moves.start[first] if first < len(moves.end) else np.zeros(3)
    for k in range(first, len(moves.end)):
        a, b = moves.start[k], moves.end[k]
        if np.abs(np.stack([a, b])[:, :2] - held[:2]).max() < 1e-6:
            continue  # up from, or down to, where the job itself stands
        wide = shaft + radius
        own = (which < k) & (ball[:, 2] + radius > min(a[2], b[2]))
        for axis in (0, 1):
            own &= ball[:, axis] > min(a[axis], b[axis]) - wide
            own &= ball[:, axis] < max(a[axis], b[axis]) + wide
        near, thick = ball[own], radius[own]
        for share in np.linspace(0, 1, max(2, int(np.linalg.norm(b - a) / 0.05))):
            if _meets(a + share * (b - a), near, thick, shaft, case.layer_mm):
                crossed += 1
                break
    return crossed


def _balls(ink: Ink, layer: float | None) -> tuple[FloatArray, FloatArray, IntArray]:
    places, radius, which = [], [], []
    for a, b, area, move in zip(ink.start, ink.end, ink.area, ink.move, strict=True):
        wide = math.sqrt(area / math.pi) if layer is None else _half_width(float(area), layer)
        shares = np.linspace(0, 1, max(2, int(np.linalg.norm(b - a) / (wide / 2)) + 1))
        places.append(a + shares[:, None] * (b - a))
        radius += [wide] * len(shares)
        which += [int(move)] * len(shares)
    return np.concatenate(places), np.array(radius), np.array(which)


def _meets(
    tip: FloatArray, ball: FloatArray, radius: FloatArray, shaft: float, layer: float | None
) -> bool:
    """Whether a cylinder that stands on a tip meets balls (or a layer's lines, above it)."""
    flat = np.hypot(ball[:, 0] - tip[0], ball[:, 1] - tip[1])
    if layer is not None:
        return bool(((ball[:, 2] > tip[2] + layer / 10) & (flat < shaft + radius)).any())
    below = np.maximum(tip[2] - ball[:, 2], 0.0)
    reach = np.sqrt(np.maximum(radius**2 - below**2, 0.0))
    meets = (ball[:, 2] + radius > tip[2] + 0.01) & (flat < shaft + reach - 0.01)
    joint = math.sqrt(2) * (shaft + radius) + EXCUSED_RADII * radius + 0.02
    return bool((meets & (np.linalg.norm(ball - tip, axis=1) > joint)).any())
