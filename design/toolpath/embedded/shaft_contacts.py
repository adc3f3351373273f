"""Find written ink that the needle's shaft enters or nears along a planned toolpath.

The plan orders elements by what the shaft meets at a few places of each. What is then written is
looked at as a whole here: all moves, travels, lifts and descents too, and all places between, by
the joints of docs/embedded.md. The check before a print asks the same of the G-code with a program
of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.needle import Needle, joint_reach
from design.toolpath.embedded.rules import TIPS, Meetings, off_part, outside_joints
from design.toolpath.embedded.shaft_kernels import Ink, InkSquares, MeetingVessels, Tips, entries
from design.toolpath.toolpath import MoveKind, Toolpath
from kernels import jit
from kernels.arrays import FloatArray, IntArray

INK_MM: Final = 0.5
TIP_MM: Final = 0.2
"""No piece of ink, and of a way of the tip, is longer."""
MAX_SQUARES: Final = 1_000_000


class WrittenMoves(NamedTuple):
    """What the moves that write lay.

    Attributes
    ----------
    vessel : (w,) int64
    along, radius : (w, 2) float64, mm
        Of both ends: way along the vessel (on beyond its end), and the filament's radius.
    """

    vessel: IntArray
    along: FloatArray
    radius: FloatArray


class Entry(NamedTuple):
    """A vessel's ink to which a piece of the path comes too near.

    Attributes
    ----------
    move : int
        Of the toolpath.
    vessel, through : int
        Being written, left or gone to; and whose ink.
    length_mm : float, mm
        Of the piece of path.
    depth_mm : float, mm
        How far the bare shaft reaches into the ink; below 0 it passes at that distance.
    """

    move: int
    vessel: int
    through: int
    length_mm: float
    depth_mm: float


class _Pieces(NamedTuple):
    """Rows cut up: of each piece its row, and the shares of the row at both ends (k, 2)."""

    row: IntArray
    share: FloatArray


def find_shaft_contacts(
    toolpath: Toolpath,
    laid: WrittenMoves,
    spared: MeetingVessels,
    needles: Sequence[Needle],
    look_mm: float,
) -> list[Entry]:
    """Find all entries and all that comes nearer than ``look_mm``, one for each piece and vessel.

    Parameters
    ----------
    toolpath : Toolpath
    laid : WrittenMoves
        Of its moves that write, in their order.
    spared : MeetingVessels
    needles : sequence of Needle
        Of each head, bare.
    look_mm : float, mm
    """
    writes = toolpath.kind == MoveKind.WRITE
    ink = _ink(toolpath, np.flatnonzero(writes), laid)
    contacts = []
    for tool, needle in enumerate(needles):
        tips, rows = _tips(toolpath, writes & (toolpath.tool == tool), laid, tool)
        if len(rows):
            squares = _squares(ink, needle, look_mm)
            hits = entries(tips, ink, squares, spared, needle, look_mm)
            contacts += _entries(hits, tips, rows)
    return contacts


def _cut(length: FloatArray, longest_mm: float) -> _Pieces:
    count = np.maximum(np.ceil(length / longest_mm), 1).astype(np.int64)
    row = np.repeat(np.arange(len(count)), count)
    nth = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    return _Pieces(row, np.column_stack([nth, nth + 1]) / count[row][:, None])


def _mixed(ends: FloatArray, pieces: _Pieces) -> FloatArray:
    """Values at rows' ends (n, 2) or (n, 2, 3) at both ends of each piece; inf stays inf."""
    low, high = ends[pieces.row, 0], ends[pieces.row, 1]
    share = pieces.share if ends.ndim == 2 else pieces.share[:, :, None]
    both = np.isfinite(low) & np.isfinite(high)
    low, high = np.where(both, low, 0.0)[:, None], np.where(both, high, 0.0)[:, None]
    return np.where(both[:, None], low + share * (high - low), np.inf)


def _ink(toolpath: Toolpath, rows: IntArray, laid: WrittenMoves) -> Ink:
    pieces = _cut(toolpath.lengths[rows], INK_MM)
    place = _mixed(np.stack([toolpath.start[rows], toolpath.end[rows]], axis=1), pieces)
    return Ink(
        np.ascontiguousarray(place[:, 0]),
        np.ascontiguousarray(place[:, 1]),
        _mixed(laid.radius, pieces),
        _mixed(laid.along, pieces),
        pieces.share.copy(),
        laid.vessel[pieces.row],
        rows[pieces.row],
    )


def _tips(
    toolpath: Toolpath, writes: NDArray[np.bool_], laid: WrittenMoves, tool: int
) -> tuple[Tips, IntArray]:
    """Ways of one head's tip, and the moves that they are of."""
    number = np.cumsum(toolpath.kind == MoveKind.WRITE) - 1
    last, following, since, until = _about(toolpath, writes)
    rows = np.flatnonzero((toolpath.tool == tool) & (toolpath.lengths > 0))
    pieces = _cut(toolpath.lengths[rows], TIP_MM)
    place = _mixed(np.stack([toolpath.start[rows], toolpath.end[rows]], axis=1), pieces)
    own = writes[rows]
    ends = np.stack([last[rows], np.where(own, -1, following[rows])])
    known, of = ends >= 0, number[ends]
    along = np.stack([
        np.repeat(np.where(known[k], laid.along[of[k], 1 - k], 0.0)[:, None], 2, axis=1)
        for k in (0, 1)
    ])  # fmt: skip
    along[0, own] = laid.along[of[0, own]]
    tips = Tips(
        np.ascontiguousarray(place[:, 0]),
        np.ascontiguousarray(place[:, 1]),
        rows[pieces.row],
        pieces.share.copy(),
        np.where(known, laid.vessel[of], -1).T[pieces.row].copy(),
        np.where(known, laid.radius.max(axis=1)[of], 0.0).T[pieces.row].copy(),
        np.stack([_mixed(one, pieces) for one in along], axis=1),
        np.stack([_mixed(one[rows], pieces) for one in (since, until)], axis=1),
    )
    return tips, rows


def _about(
    toolpath: Toolpath, writes: NDArray[np.bool_]
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Last written row at or before each, next at or after (-1: none), and ways from and to these.

    A rise out of a pass's end and a descent to a start count by what they go in the plan alone: a
    needle that rises stands in the same ink as before. inf where there is none.
    """
    rows, count = np.arange(len(toolpath)), len(toolpath)
    last = np.maximum.accumulate(np.where(writes, rows, -1))
    following = np.minimum.accumulate(np.where(writes, rows, count)[::-1])[::-1]
    step, length = toolpath.end - toolpath.start, toolpath.lengths
    flat = np.hypot(step[:, 0], step[:, 1])
    up = np.append(0.0, np.cumsum(np.where(writes, 0.0, np.where(step[:, 2] >= 0, flat, length))))
    down = np.append(0.0, np.cumsum(np.where(writes, 0.0, np.where(step[:, 2] <= 0, flat, length))))
    both = np.column_stack([rows, rows + 1])
    since = np.where(last[:, None] >= 0, up[both] - up[last + 1][:, None], np.inf)
    next_row = np.minimum(following, count - 1)
    until = np.where(following[:, None] < count, down[next_row][:, None] - down[both], np.inf)
    following = np.where(following < count, following, -1)
    return last, following, np.maximum(since, 0.0), np.maximum(until, 0.0)


def _squares(ink: Ink, needle: Needle, look_mm: float) -> InkSquares:
    middle = (ink.start[:, :2] + ink.end[:, :2]) / 2
    low, size = middle.min(axis=0), np.ptp(middle, axis=0)
    room = needle.shaft_mm + float(ink.radius.max()) + look_mm + (INK_MM + TIP_MM) / 2
    pitch = max(room, float(np.sqrt(size.prod() / MAX_SQUARES)), float(size.max()) / 4000)
    at = np.floor((middle - low) / pitch).astype(np.int64)
    shape = at.max(axis=0) + 1
    square = at[:, 0] * shape[1] + at[:, 1]
    begin = np.concatenate([[0], np.cumsum(np.bincount(square, minlength=int(shape.prod())))])
    return InkSquares(low, pitch, shape, begin, np.argsort(square, kind="stable"))


def _entries(hits: NDArray[np.void], tips: Tips, rows: IntArray) -> list[Entry]:
    piece = hits["piece"]
    length = np.linalg.norm(tips.end[piece] - tips.start[piece], axis=1)
    vessel = tips.vessel[piece]
    rises = (tips.end[piece, 2] > tips.start[piece, 2]) | (vessel[:, 1] < 0)
    own = np.where(rises & (vessel[:, 0] >= 0), vessel[:, 0], vessel[:, 1])
    columns = (tips.row[piece], own, hits["vessel"], length, -hits["value"])
    return [Entry(*one) for one in zip(*(column.tolist() for column in columns), strict=True)]


# Compute how far the needle's shaft enters one vessel's ink while it writes another.

TOUCH_MM: Final = 0.005
"""Deeper is a crossing, as for the check before a print."""
CERTAIN_MM: Final = TOUCH_MM - 0.002
"""No deeper is none, either, once the path is rounded to the digits of its G-code."""


@jit
def entry_mm(i: int, j: int, elements: Elements, meetings: Meetings, needle: Needle) -> float:
    """Depth of the shaft in element j, outside joints, while i is written, mm; 0 for none."""
    tail, head = elements.point[elements.end[i, 0]], elements.point[elements.end[i, 1]]
    a, b = elements.point[elements.end[j, 0]], elements.point[elements.end[j, 1]]
    thick = max(elements.radius[j, 0], elements.radius[j, 1])
    wide = max(thick, max(elements.radius[i, 0], elements.radius[i, 1]))
    reach, most = joint_reach(needle, wide), 0.0
    for k in range(TIPS):
        share = k / (TIPS - 1.0)
        tip = tail + share * (head - tail)
        if thick - off_part(tip, a, b, 0.0, 1.0, needle) <= most:
            continue
        at = elements.arc[i] + share * elements.length[i]
        low, high = outside_joints(elements.vessel[i], at, j, reach, elements, meetings)
        if low < high:
            most = max(most, thick - off_part(tip, a, b, low, high, needle))
    return most


@jit
def entries_mm(
    first: IntArray, after: IntArray, elements: Elements, meetings: Meetings, needle: Needle
) -> FloatArray:
    """`entry_mm` of pairs: into the second of each, (k,), while the first is written."""
    depths = np.empty(len(first))
    for k in range(len(first)):
        depths[k] = entry_mm(first[k], after[k], elements, meetings, needle)
    return depths


@jit
def near_pairs(v: int, w: int, elements: Elements, needle: Needle) -> IntArray:
    """Elements of two vessels (k, 2) that the needle may touch together, each pair once."""
    pairs = [(0, 0)][:0]
    thick, longest = 0.0, 0.0
    for vessel in (v, w):
        for i in range(elements.first[vessel], elements.first[vessel + 1]):
            thick = max(thick, max(elements.radius[i, 0], elements.radius[i, 1]))
            longest = max(longest, elements.length[i])
    room = needle.shaft_mm + thick + longest
    for i in range(elements.first[v], elements.first[v + 1]):
        p, q = elements.point[elements.end[i, 0]], elements.point[elements.end[i, 1]]
        for j in range(elements.first[w], elements.first[w + 1]):
            a, b = elements.point[elements.end[j, 0]], elements.point[elements.end[j, 1]]
            x, y = 0.5 * (p[0] + q[0] - a[0] - b[0]), 0.5 * (p[1] + q[1] - a[1] - b[1])
            if x * x + y * y < room * room and (v != w or i < j):
                pairs.append((i, j))
    out = np.empty((len(pairs), 2), np.int64)
    for k in range(len(pairs)):
        out[k, 0], out[k, 1] = pairs[k]
    return out


@jit
def bar_each_other(pairs: IntArray, elements: Elements, meetings: Meetings, needle: Needle) -> bool:
    """Whether the needle enters one or the other of some pair of elements in either order."""
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        if entry_mm(i, j, elements, meetings, needle) > CERTAIN_MM and (
            entry_mm(j, i, elements, meetings, needle) > CERTAIN_MM
        ):
            return True
    return False
