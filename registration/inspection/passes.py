"""For each pixel of a view, the lines that pass near it: how far, on which side, in which direction.

A line's own way back, or another line, is another pass; the pieces around a pixel on one way are
one, at the least distance. All that a look expects to see is drawn from these.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray
from kernels.compile import jit
from registration.inspection.values import ExpectedLines, Frame
from registration.inspection.ways import from_stroke_begin

REACH: Final = 1.5
"""Widths from its middle as far as a line is seen: its rim, shade and blur."""
_MOST: Final = 4
"""Passes kept of a pixel: a crossing of two lines that each touch a neighbour."""
_SEEN: Final = 0.3
"""Of its width at least that a piece with a direction shows."""
_DETOUR: Final = 2.5
"""Widths along a line, from which on it has come back."""


@dataclass(frozen=True)
class Pieces:
    """Straight pieces of lines in a view.

    Attributes
    ----------
    start, end : (n, 2) float64, px
    width : (n,) float64, px
    along : (n,) float64, px
        From the begin of its stroke to that of the piece.
    stroke : (n,) int64
    kind : (n,) int64
        0 of the layer, 1 older.
    """

    start: FloatArray
    end: FloatArray
    width: FloatArray
    along: FloatArray
    stroke: IntArray
    kind: IntArray

    @staticmethod
    def of(lines: ExpectedLines, frame: Frame) -> Pieces:
        """Look up where a frame shows lines, and how wide at right angles to their way there."""
        way = lines.end - lines.start
        flat = np.maximum(np.linalg.norm(way[:, :2], axis=1, keepdims=True), 1e-9)
        left = np.column_stack([-way[:, 1], way[:, 0], np.zeros(len(way))]) / flat
        start, end = frame.to_pixels(lines.start), frame.to_pixels(lines.end)
        middle, half = 0.5 * (lines.start + lines.end), 0.5 * lines.width_mm[:, None] * left
        across = frame.to_pixels(middle + half) - frame.to_pixels(middle - half)
        ahead = end - start
        area = np.abs(across[:, 0] * ahead[:, 1] - across[:, 1] * ahead[:, 0])
        width = area / np.maximum(np.linalg.norm(ahead, axis=1), 1e-9)
        # A piece that is hardly longer than a point, or steep, has no direction in the view.
        whole = np.linalg.norm(across, axis=1)
        width = np.where(width > _SEEN * whole, width, whole)
        length = np.linalg.norm(way, axis=1)
        scale = float(np.nanmedian(width / lines.width_mm))
        begin = from_stroke_begin(lines.stroke, length)
        return Pieces(
            np.ascontiguousarray(start), np.ascontiguousarray(end), width, scale * begin,
            lines.stroke.astype(np.int64), np.where(lines.fresh, 0, 1).astype(np.int64),
        )  # fmt: skip


@dataclass(frozen=True)
class Passes:
    """Lines near each pixel, in no order.

    Attributes
    ----------
    count : (h, w) int64
    distance : (h, w, 4) float32, widths
        From the middle, positive to the left of the way as it is seen.
    turn : (h, w, 4, 2) float32
        Unit normal to the left, px.
    piece : (h, w, 4) int32
        Row of the nearest piece; -1 for none.
    part : (h, w, 4) float32
        Of the way along it, 0 to 1.
    """

    count: IntArray
    distance: NDArray[np.float32]
    turn: NDArray[np.float32]
    piece: NDArray[np.int32]
    part: NDArray[np.float32]

    @staticmethod
    def of(pieces: Pieces, shape: tuple[int, int]) -> Passes:
        """Look for lines within `REACH` of each pixel."""
        out = Passes(
            np.zeros(shape, dtype=np.int64),
            np.full((*shape, _MOST), 9.0, dtype=np.float32),
            np.zeros((*shape, _MOST, 2), dtype=np.float32),
            np.full((*shape, _MOST), -1, dtype=np.int32),
            np.zeros((*shape, _MOST), dtype=np.float32),
        )
        _lay(
            pieces.start, pieces.end, pieces.width, pieces.along, pieces.stroke, pieces.kind,
            out.count, out.distance, out.turn, out.piece, out.part,
        )  # fmt: skip
        return out

    def nearest(self, kind: IntArray, which: int) -> NDArray[np.float32]:
        """Distance to the nearest line of a kind, (h, w), widths; 9 for none."""
        own = np.append(kind == which, False)[self.piece]
        return np.asarray(np.where(own, np.abs(self.distance), np.float32(9.0)).min(axis=2))


@jit
def _lay(
    start: FloatArray,
    end: FloatArray,
    width: FloatArray,
    along: FloatArray,
    stroke: IntArray,
    kind: IntArray,
    count: NDArray[Any],
    distance: NDArray[Any],
    turn: NDArray[Any],
    piece: NDArray[Any],
    part: NDArray[Any],
) -> None:
    """Fill `Passes` in place."""
    high, wide = count.shape
    for k in range(len(width)):
        ax, ay, bx, by = start[k, 0], start[k, 1], end[k, 0], end[k, 1]
        if not (abs(ax) < 1e6 and abs(ay) < 1e6 and abs(bx) < 1e6 and abs(by) < 1e6):
            continue
        reach = REACH * width[k]
        x0, x1 = max(0, int(min(ax, bx) - reach)), min(wide - 1, int(max(ax, bx) + reach) + 1)
        y0, y1 = max(0, int(min(ay, by) - reach)), min(high - 1, int(max(ay, by) + reach) + 1)
        dx, dy = bx - ax, by - ay
        length = np.sqrt(dx * dx + dy * dy)
        if length < 1e-9:
            continue
        ux, uy = dx / length, dy / length
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                px, py = x - ax, y - ay
                t = min(max(px * ux + py * uy, 0.0), length)
                ox, oy = px - t * ux, py - t * uy
                off = np.sqrt(ox * ox + oy * oy)
                if off >= reach:
                    continue
                side = ux * py - uy * px
                d = (off if side >= 0 else -off) / width[k]
                _keep(
                    y, x, k, d, -uy, ux, t / length, along[k] + t, along, stroke, start, end,
                    width, kind, count, distance, turn, piece, part,
                )  # fmt: skip


@jit
def _keep(
    y: int,
    x: int,
    k: int,
    d: float,
    nx: float,
    ny: float,
    share: float,
    at: float,
    along: FloatArray,
    stroke: IntArray,
    start: FloatArray,
    end: FloatArray,
    width: FloatArray,
    kind: IntArray,
    count: NDArray[Any],
    distance: NDArray[Any],
    turn: NDArray[Any],
    piece: NDArray[Any],
    part: NDArray[Any],
) -> None:
    """Keep a pass where it is nearer than the one of the same way, or than the farthest kept."""
    slot = -1
    for m in range(count[y, x]):
        other = piece[y, x, m]
        if stroke[other] == stroke[k] and kind[other] == kind[k]:
            size = np.sqrt(
                (end[other, 0] - start[other, 0]) ** 2 + (end[other, 1] - start[other, 1]) ** 2
            )
            there = along[other] + part[y, x, m] * size
            if abs(there - at) < _DETOUR * width[k]:
                slot = m
                break
    if slot >= 0 and abs(distance[y, x, slot]) <= abs(d):
        return
    if slot < 0 and count[y, x] < _MOST:
        slot = count[y, x]
        count[y, x] += 1
    elif slot < 0:
        slot = 0
        for m in range(1, _MOST):
            if abs(distance[y, x, m]) > abs(distance[y, x, slot]):
                slot = m
        if abs(distance[y, x, slot]) <= abs(d):
            return
    distance[y, x, slot] = d
    turn[y, x, slot, 0] = nx
    turn[y, x, slot, 1] = ny
    piece[y, x, slot] = k
    part[y, x, slot] = share
