"""Find the lines that pass near each pixel: distance, side and direction.

A line's own way back, or another line, is another pass; the pieces around a pixel on one way are
one, at the least distance. The model of a view is rendered from these.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray
from kernels.compile import jit
from printctl.inspection.path_samples import from_stroke_begin
from printctl.inspection.values import ExpectedLines, Frame

REACH_WIDTHS: Final = 1.5
"""Distance from a line's middle, in widths, to which its rim, shade and blur reach."""
_MAX_PASSES: Final = 4
"""Passes kept for a pixel: enough for a crossing of two lines that each touch a neighbour."""
_MIN_VISIBLE_WIDTH_SHARE: Final = 0.3
"""Least visible share of the width of a piece with a direction in the view."""
_RETURN_WIDTHS: Final = 2.5
"""Path length in widths after which a line counts as coming back."""


class Pieces(NamedTuple):
    """Straight pieces of lines, projected into a view.

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
        """Project lines by a frame; widths at right angles to their projection."""
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
        width = np.where(width > _MIN_VISIBLE_WIDTH_SHARE * whole, width, whole)
        length = np.linalg.norm(way, axis=1)
        scale = float(np.nanmedian(width / lines.width_mm))
        begin = from_stroke_begin(lines.stroke, length)
        return Pieces(
            np.ascontiguousarray(start), np.ascontiguousarray(end), width, scale * begin,
            lines.stroke.astype(np.int64), np.where(lines.fresh, 0, 1).astype(np.int64),
        )  # fmt: skip


class Passes(NamedTuple):
    """Lines near each pixel of a view, unordered.

    Attributes
    ----------
    number : (h, w) int64
    distance : (h, w, 4) float32, widths
        From the middle, positive to the left of the way as it is seen.
    normal : (h, w, 4, 2) float32
        Unit normal to the left, px.
    piece : (h, w, 4) int32
        Row of the nearest piece; -1 for none.
    part : (h, w, 4) float32
        Of the way along it, 0 to 1.
    near : (h, w, 2) float32, widths
        Distance to the nearest fresh and to the nearest older line; 9 for none.
    """

    number: IntArray
    distance: NDArray[np.float32]
    normal: NDArray[np.float32]
    piece: NDArray[np.int32]
    part: NDArray[np.float32]
    near: NDArray[np.float32]

    @staticmethod
    def of(pieces: Pieces, shape: tuple[int, int]) -> Passes:
        """Find lines within the reach of each pixel."""
        out = Passes(
            np.zeros(shape, dtype=np.int64),
            np.full((*shape, _MAX_PASSES), 9.0, dtype=np.float32),
            np.zeros((*shape, _MAX_PASSES, 2), dtype=np.float32),
            np.full((*shape, _MAX_PASSES), -1, dtype=np.int32),
            np.zeros((*shape, _MAX_PASSES), dtype=np.float32),
            np.full((*shape, 2), 9.0, dtype=np.float32),
        )
        _lay(pieces, out, np.zeros((*shape, _MAX_PASSES), dtype=np.float32))
        return out


@jit
def _lay(pieces: Pieces, out: Passes, along_at: NDArray[Any]) -> None:
    """Fill passes in place; ``along_at`` (h, w, 4) is each one's way along its stroke, px."""
    # Values of several arrays would be slower in the inner loop.
    start, end, width, along, stroke, kind = pieces
    number, distance, normal, piece, part, near = out
    high, wide = number.shape
    for k in range(len(width)):
        ax, ay, bx, by = start[k, 0], start[k, 1], end[k, 0], end[k, 1]
        if not (abs(ax) < 1e6 and abs(ay) < 1e6 and abs(bx) < 1e6 and abs(by) < 1e6):
            continue
        reach = REACH_WIDTHS * width[k]
        dx, dy = bx - ax, by - ay
        length = np.sqrt(dx * dx + dy * dy)
        if length < 1e-9:
            continue
        ux, uy = dx / length, dy / length
        y0, y1 = max(0, int(min(ay, by) - reach)), min(high - 1, int(max(ay, by) + reach) + 1)
        for y in range(y0, y1 + 1):
            # Of the piece only what lies within reach of this row can be near its pixels.
            low, top = 0.0, length
            if abs(uy) > 1e-9:
                a, b = (y - reach - ay) / uy, (y + reach - ay) / uy
                low, top = max(low, min(a, b)), min(top, max(a, b))
                if low > top:
                    continue
            first, last = ax + low * ux, ax + top * ux
            x0 = max(0, int(min(first, last) - reach))
            x1 = min(wide - 1, int(max(first, last) + reach) + 1)
            for x in range(x0, x1 + 1):
                px, py = x - ax, y - ay
                t = min(max(px * ux + py * uy, 0.0), length)
                ox, oy = px - t * ux, py - t * uy
                square = ox * ox + oy * oy
                if square >= reach * reach:
                    continue
                off = np.sqrt(square) / width[k]
                if off < near[y, x, kind[k]]:
                    near[y, x, kind[k]] = off
                slot = _slot(
                    y, x, k, off, along[k] + t, width[k], stroke, kind, number, distance, piece,
                    along_at,
                )  # fmt: skip
                if slot < 0:
                    continue
                distance[y, x, slot] = off if ux * py - uy * px >= 0 else -off
                normal[y, x, slot, 0], normal[y, x, slot, 1] = -uy, ux
                piece[y, x, slot] = k
                part[y, x, slot] = t / length
                along_at[y, x, slot] = along[k] + t


@jit
def _slot(
    y: int,
    x: int,
    k: int,
    off: float,
    at: float,
    wide: float,
    stroke: IntArray,
    kind: IntArray,
    number: IntArray,
    distance: NDArray[Any],
    piece: NDArray[Any],
    along_at: NDArray[Any],
) -> int:
    """Return the slot to keep a pass in (of the same way, free, or the farthest), or -1."""
    for m in range(number[y, x]):
        other = piece[y, x, m]
        if (
            stroke[other] == stroke[k]
            and kind[other] == kind[k]
            and abs(along_at[y, x, m] - at) < _RETURN_WIDTHS * wide
        ):
            return m if off < abs(distance[y, x, m]) else -1
    if number[y, x] < _MAX_PASSES:
        number[y, x] += 1
        return int(number[y, x] - 1)
    slot = 0
    for m in range(1, _MAX_PASSES):
        if abs(distance[y, x, m]) > abs(distance[y, x, slot]):
            slot = m
    return slot if off < abs(distance[y, x, slot]) else -1
