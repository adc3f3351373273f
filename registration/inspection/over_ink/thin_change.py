"""Tell stretches of lines that changed a picture near their middle alone: their ink may be thin.

A line that lacks half of its ink is narrower, so that nothing changes near the edges it should
have. How much a window of a line changed the picture there, and in its middle, is taken over the
mean of windows like it: of the look, of its direction, width and neighbours, and on as much older
ink on each side. Light, highlights and shade of ridges change both parts, or a line's whole length.
So only what begins or ends within a line is told, where windows of other lines scatter far less.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.over_ink.picture_change import ACROSS, Change
from registration.inspection.pictures.working import Mask
from registration.inspection.ways import Seen, Ways, stretches_of

_MIDDLE: Final = np.abs(ACROSS) < 0.2
_EDGES: Final = (np.abs(ACROSS) > 0.28) & (np.abs(ACROSS) < 0.46)
"""Parts across a line: beyond them its edge is blurred, or other lines touch it."""
_WINDOW: Final = 4.0
"""Widths along a line."""
_SHORTEST: Final = 12.0
"""Widths of a stretch that is told."""
_TOLD: Final = 0.5
"""Of a window's places, that must be known, away from turns and crossings."""
_PARALLEL: Final = math.cos(math.radians(2 * 20.0))
"""Cosine of twice the angle between lines of one direction."""
_LIKE: Final = 0.35
"""Of a part of a line: on as much more or less older ink, or beside a neighbour, it is another's
like."""
_WIDER: Final = 0.15
"""Logarithm of widths of lines that are alike."""
_PEERS: Final = 3
"""Windows like one that aren't thin, fewer of which tell nothing of it."""
_REST: Final = 6
"""The same like any of a stretch's, and the lines that they are of."""
_LINES: Final = 2
_THIN: Final = 0.65
"""Of the change near the edges, below which a window may be thin; of sound ink's on which light
tells it, windows had 0.7 to 1.2."""
_CAME: Final = 0.6
"""And of that in the middle, above which ink came: highlights and shade lower both."""
_GROUNDS: Final = 20.0
"""Times what ground reaches, that ink must change: clear ink's highlights wander (18 and less)."""
_SPREADS: Final = 3.5
"""Standard deviations of windows like them."""
_LEAST_SPREAD: Final = 0.02
_UPPER: Final = 75.0
"""Percentile above the middle that tells the spread; below it thin ones lie."""
_PER_SPREAD: Final = 0.6745
"""Standard deviations from the middle to it."""
_ROUNDS: Final = 3
_CHUNK: Final = 256
_PARTS: Final = ((-0.7, -0.2), (-0.2, 0.2), (0.2, 0.7))
"""Across a line, whose share of older ink counts."""


@dataclass(frozen=True)
class ThinChange:
    """What the change tells of thin ink.

    Attributes
    ----------
    thin : (n,) bool
        Places of stretches that changed near the middle alone.
    told : (n,) bool
        Places at which such a stretch would be told.
    """

    thin: BoolArray
    told: BoolArray


@dataclass(frozen=True)
class _Windows:
    """Windows along lines, in the order of writing.

    Attributes
    ----------
    first, last : (k,) int64
        Rows of places.
    line : (k,) int64
        Straight part of a path.
    length : (k,) float64, mm
    edges, middle : (k, u) float64
        How the picture changed there, mean along the window.
    kind : (k, 5) float64
        Older ink and neighbours, by parts and sides.
    way : (k, 2) float64
        Twice the direction's angle.
    width : (k,) float64
        Its logarithm.
    """

    first: IntArray
    last: IntArray
    line: IntArray
    length: FloatArray
    edges: FloatArray
    middle: FloatArray
    kind: FloatArray
    way: FloatArray
    width: FloatArray

    def __len__(self) -> int:
        return len(self.first)

    def like(self, rows: IntArray) -> BoolArray:
        """Which windows are like some, (m, k)."""
        out = self.way[rows] @ self.way.T > _PARALLEL
        out &= np.abs(self.width[rows, None] - self.width) < _WIDER
        for part in self.kind.T:
            out &= np.abs(part[rows, None] - part) < _LIKE
        return np.asarray(out)


def thin_by_change(change: Change, ways: Ways, seen: Seen, old: Mask) -> ThinChange:
    """Find such stretches along places; ``old`` is where older ink lies, (h, w)."""
    thin, told = (np.zeros(len(ways), dtype=np.bool_) for _ in range(2))
    windows = _windows(change, ways, seen, old)
    if windows is None:
        return ThinChange(thin, told)
    edges, middle = _over_their_like(windows)
    low = np.nan_to_num(edges, nan=1.0) < _THIN
    limit = float(np.nanmedian(change.limit))
    between = np.isnan(edges) & np.append(False, low[:-1]) & np.append(low[1:], False)
    for first, last in stretches_of(low | between, np.zeros(len(low), dtype=np.int64)):
        own = np.arange(first, last + 1)
        if windows.length[own].sum() < _SHORTEST * float(np.median(ways.width)):
            continue
        if _is_thin(windows, own, edges, middle, low, limit):
            for k in own:
                thin[windows.first[k] : windows.last[k] + 1] = True
    for k in np.flatnonzero(np.isfinite(edges) & _comparable(windows, edges, low, limit)):
        told[windows.first[k] : windows.last[k] + 1] = True
    return ThinChange(thin, told)


def _comparable(windows: _Windows, edges: FloatArray, low: BoolArray, limit: float) -> BoolArray:
    """Whether enough windows like each changed enough for a thin stretch to be told, (k,)."""
    sound = ~low & np.isfinite(edges)
    strength = (windows.edges**2).mean(axis=1)
    on_line = (windows.line[:, None] == np.unique(windows.line)).astype(np.float64)
    out = np.zeros(len(windows), dtype=np.bool_)
    for begin in range(0, len(windows), _CHUNK):
        rows = np.arange(begin, min(begin + _CHUNK, len(windows)))
        rest = windows.like(rows) & sound
        number = rest.sum(axis=1)
        usual = np.sqrt(rest @ strength / np.maximum(number, 1))
        lines = (rest @ on_line > 0).sum(axis=1)
        out[rows] = (number >= _REST) & (lines >= _LINES) & (usual > _GROUNDS * limit)
    return out


def _is_thin(
    windows: _Windows,
    own: IntArray,
    edges: FloatArray,
    middle: FloatArray,
    low: BoolArray,
    limit: float,
) -> bool:
    """Whether a row of windows changed near the middle alone, beyond the scatter of its like."""
    rest = windows.like(own).any(axis=0) & ~low & np.isfinite(edges)
    if rest.sum() < _REST or len(np.unique(windows.line[rest])) < _LINES:
        return False
    usual = float(np.sqrt((windows.edges[rest] ** 2).mean()))
    if not (usual > _GROUNDS * limit and float(np.nanmedian(middle[own])) > _CAME):
        return False
    usually = float(np.median(edges[rest]))
    spread = (float(np.percentile(edges[rest], _UPPER)) - usually) / _PER_SPREAD
    if usually - float(np.nanmedian(edges[own])) < _SPREADS * max(spread, _LEAST_SPREAD):
        return False
    begin, end = own[0], own[-1]
    before = begin > 0 and windows.line[begin - 1] == windows.line[begin]
    behind = end + 1 < len(windows) and windows.line[end + 1] == windows.line[end]
    inside = (before and bool(np.isfinite(edges[begin - 1]))) or (
        behind and bool(np.isfinite(edges[end + 1]))
    )
    return bool(inside)


def _over_their_like(windows: _Windows) -> tuple[FloatArray, FloatArray]:
    """How much each window changed over the mean of its like, near edges and in the middle, (k,).

    That mean is first of the half that changed most, then of those that aren't thin. NaN where too
    few are like it.
    """
    count = len(windows)
    edges, middle = np.full(count, np.nan), np.full(count, np.nan)
    strength = (windows.edges**2).mean(axis=1)
    for turn in range(_ROUNDS):
        low = np.nan_to_num(edges, nan=1.0) < _THIN
        for begin in range(0, count, _CHUNK):
            rows = np.arange(begin, min(begin + _CHUNK, count))
            use = windows.like(rows)
            if turn == 0:
                ranked = np.where(use, strength, np.nan)
                use &= ranked >= np.nanmedian(ranked, axis=1, keepdims=True)
            else:
                use &= ~low
            number = use.sum(axis=1)
            few = number < (1 if turn == 0 else _PEERS)
            for out, change in ((edges, windows.edges), (middle, windows.middle)):
                mean = use @ change / np.maximum(number, 1)[:, None]
                size = np.maximum((mean**2).sum(axis=1), 1e-12)
                out[rows] = np.where(few, np.nan, (change[rows] * mean).sum(axis=1) / size)
    return edges, middle


def _windows(change: Change, ways: Ways, seen: Seen, old: Mask) -> _Windows | None:
    """Lay windows along lines, without turns, crossings and what isn't known."""
    use = np.isfinite(change.rms) & ~ways.crossed & ~ways.corners()
    parts = [one for one in _parts(ways) if use[one].mean() > _TOLD]
    if not parts:
        return None
    flipped = (ways.normal[:, 1] < 0) | ((ways.normal[:, 1] == 0) & (ways.normal[:, 0] < 0))
    profiles = np.where(flipped[:, None, None], change.profiles[:, ::-1], change.profiles)
    across = np.linspace(-0.7, 0.7, 29)
    older = seen.profiles(old, ways.width[:, None] * across, nearest=True).astype(np.float64)
    older = np.where(flipped[:, None], older[:, ::-1], older)
    shares = [older[:, (across > a) & (across < b)].mean(axis=1) for a, b in _PARTS]
    beside = np.isfinite(ways.seams).astype(np.float64)
    beside = np.where(flipped, beside[::-1], beside)
    x, y = ways.normal.T
    twice: FloatArray = np.column_stack([x * x - y * y, 2.0 * x * y])

    def mean(values: FloatArray) -> FloatArray:
        return np.array([values[one][use[one]].mean(axis=0) for one in parts])

    way = mean(twice)
    return _Windows(
        np.array([one[0] for one in parts]),
        np.array([one[-1] for one in parts]),
        _lines(ways)[[one[len(one) // 2] for one in parts]],
        np.array([float(ways.step[one].sum()) for one in parts]),
        mean(profiles[:, _EDGES].reshape(len(ways), -1).astype(np.float64)),
        mean(profiles[:, _MIDDLE].reshape(len(ways), -1).astype(np.float64)),
        mean(np.column_stack([*shares, *beside])),
        way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9),
        np.log(mean(ways.width)),
    )


def _parts(ways: Ways) -> list[IntArray]:
    """Rows of each window."""
    out = list[IntArray]()
    length = _WINDOW * float(np.median(ways.width))
    for run in np.unique(ways.run):
        rows = np.flatnonzero(ways.run == run)
        out += np.array_split(rows, max(1, round(float(ways.step[rows].sum()) / length)))
    return out


def _lines(ways: Ways) -> IntArray:
    """Number of the straight, or smoothly bent, part of a path that each place lies on, (n,)."""
    turned = (ways.normal[1:] * ways.normal[:-1]).sum(axis=1) < 0.9
    return np.asarray(np.cumsum(np.append(False, turned | (np.diff(ways.run) != 0))))
