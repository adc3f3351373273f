"""Lines of ink that a G-code file writes, each a stadium seen from above."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from printctl.errors import UsageError
from sim.gcode import Program, code, parse_line, read_gcode
from sim.gcode_modal import MOVE

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

WINDOW_MM: Final = 1.0
"""Way over which the flow is taken: E has few digits, and says little over a short move."""
LEVEL_TOLERANCE_MM: Final = 5e-3
FLAT_MM: Final = 1e-3


@dataclass(frozen=True)
class WrittenLines:
    """What is written, in the printer's frame.

    Attributes
    ----------
    start, end : (n, 2) float64, mm
    width : (n,) float64, mm
        Cross-section over the layer's thickness.
    layer : (n,) int64
        From 0 for the lowest.
    low, high : (k,) float64, mm
        Of each layer's slab; the tip stands at its top.
    line : (n,) int64
        Line of the file, from 1.
    """

    start: FloatArray
    end: FloatArray
    width: FloatArray
    layer: IntArray
    low: FloatArray
    high: FloatArray
    line: IntArray

    def __len__(self) -> int:
        return len(self.width)

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the ink, (2, 3), mm."""
        half = self.width[:, None] / 2
        low = (np.minimum(self.start, self.end) - half).min(axis=0)
        high = (np.maximum(self.start, self.end) + half).max(axis=0)
        return np.array([[*low, self.low[0]], [*high, self.high[-1]]])


def read_lines(
    gcode: bytes,
    ul_per_e: float | None,
    *,
    line_mm: float | None = None,
    layer_mm: float | None = None,
    rounded: bool = False,
) -> WrittenLines:
    """Read what any slicer's G-code writes in layers.

    A line's cross-section is its volume over its length. It is as wide as that over the layer's
    thickness, width x thickness; or, ``rounded``, as slicers for plastic plan it, a rectangle with
    round sides, (w - h) h + π h²/4.

    Parameters
    ----------
    gcode : bytes
    ul_per_e : float or None, µL/mm
        Volume per unit of E: the plunger's or filament's cross-section, mm². None where
        ``line_mm`` says how wide lines are.
    line_mm : float or None, mm
        Width of every line, whatever E says.
    layer_mm : float or None, mm
        Thickness of the lowest layer and of those with nothing right below; None finds the most
        frequent one.
    rounded : bool

    Raises
    ------
    UsageError
        When nothing is written, writing isn't in level layers, or the widths are impossible.
    GcodeError
        When the bytes aren't text.
    """
    program = read_gcode(gcode)
    return _lines(program, _origin(program, gcode), ul_per_e, line_mm, layer_mm, rounded)


def rounded_to_steps(lines: WrittenLines, steps_per_mm: tuple[float, float]) -> WrittenLines:
    """The same lines between the whole motor steps of x and y; widths stay."""
    steps = np.array(steps_per_mm)
    return replace(
        lines,
        start=np.rint(lines.start * steps) / steps,
        end=np.rint(lines.end * steps) / steps,
    )


def _origin(program: Program, gcode: bytes) -> FloatArray:
    """What to add to the reader's positions for those that the file writes, (3,), mm.

    A job may begin by saying with G92 where the tip stands; the reader, which knows no place for
    it, begins at zero.
    """
    moves = np.flatnonzero(program.kind == MOVE)
    before = np.flatnonzero(program.code[: moves[0] if len(moves) else 0] == code("G92"))
    added = np.zeros(3)
    for row in before:
        text = gcode.split(b"\n", int(program.line[row]))[int(program.line[row]) - 1]
        values = parse_line(text).values
        for axis, letter in enumerate("XYZ"):
            if letter in values:
                added[axis] = values[letter] - program.target[row, axis]
    return added


def _lines(
    program: Program,
    origin: FloatArray,
    ul_per_e: float | None,
    line_mm: float | None,
    layer_mm: float | None,
    rounded: bool,
) -> WrittenLines:
    begin = np.vstack([program.start[None, :3], program.target[:-1, :3]])
    pushed = np.diff(program.plunger, prepend=0.0)
    length = np.hypot(*(program.target[:, :2] - begin[:, :2]).T)
    wrote = (program.kind == MOVE) & (pushed > 0) & (length > 1e-6)
    chosen = np.flatnonzero(wrote)
    if len(chosen) == 0:
        raise UsageError("no move of the G-code pushes ink while it goes sideways; is E in it?")
    begin, end = begin[chosen] + origin, program.target[chosen, :3] + origin
    _check_level(begin, end, program.line[chosen])
    low, high, layer = _slabs(end[:, 2], layer_mm)
    if line_mm is not None:
        width = np.full(len(chosen), line_mm)
    elif ul_per_e is not None:
        stroke = np.cumsum(~wrote & (program.kind == MOVE))[chosen]
        thick = (high - low)[layer]
        width = _flow(length[chosen], pushed[chosen], stroke) * ul_per_e / thick
        width = np.minimum(width, _dot(pushed[chosen], stroke) * np.sqrt(ul_per_e / thick))
        if rounded:
            width += thick * (1 - np.pi / 4)
    else:
        raise UsageError("what one E means isn't known; give a syringe, a filament or line widths")
    _check_width(width, program.line[chosen])
    return WrittenLines(
        np.ascontiguousarray(begin[:, :2]),
        np.ascontiguousarray(end[:, :2]),
        width,
        layer,
        low,
        high,
        program.line[chosen],
    )


def _check_level(begin: FloatArray, end: FloatArray, line: IntArray) -> None:
    tilted = np.flatnonzero(np.abs(end[:, 2] - begin[:, 2]) > FLAT_MM)
    if len(tilted):
        k = tilted[0]
        raise UsageError(
            f"line {line[k]} writes from z {begin[k, 2]:g} to {end[k, 2]:g} mm "
            f"({len(tilted)} such lines): lumens are read from level layers; an embedded print or "
            "a spiral has none"
        )


def _check_width(width: FloatArray, line: IntArray) -> None:
    """Widths of a wrong unit or bore are far off, and every lumen would be wrong with them."""
    middle = float(np.median(width))
    if not 5e-3 <= middle <= 10.0:
        k = int(np.argmin(np.abs(width - middle)))
        raise UsageError(
            f"lines would be {1e3 * middle:.3g} µm wide (median; so line {line[k]}), which is "
            "outside 5 to 10000 µm; check what E means: the syringe or the filament's diameter"
        )


def _slabs(height: FloatArray, layer_mm: float | None) -> tuple[FloatArray, FloatArray, IntArray]:
    """Slab of each level, down to the level below or by the usual thickness, and each line's."""
    ordered = np.unique(np.round(height, 4))
    new = np.concatenate([[True], np.diff(ordered) > LEVEL_TOLERANCE_MM])
    high = ordered[new]
    gaps = np.diff(high)
    if layer_mm is None and len(gaps) == 0:
        raise UsageError("the G-code has one layer, whose thickness is unknown; give --layer-um")
    if layer_mm is None:
        values, counts = np.unique(np.round(gaps, 3), return_counts=True)
        layer_mm = float(values[counts.argmax()])
    thick = np.concatenate([[layer_mm], np.where(gaps > 1.5 * layer_mm, layer_mm, gaps)])
    layer = np.searchsorted(high, height + LEVEL_TOLERANCE_MM, side="right") - 1
    return high - thick, high, layer.astype(np.int64)


def _flow(length: FloatArray, pushed: FloatArray, stroke: IntArray) -> FloatArray:
    """E per mm of way, over `WINDOW_MM` about each move's middle, within its stroke."""
    way = np.concatenate([[0.0], np.cumsum(length)])
    dosed = np.concatenate([[0.0], np.cumsum(pushed)])
    opens = way[np.searchsorted(stroke, stroke, side="left")]
    shuts = way[np.searchsorted(stroke, stroke, side="right")]
    half = np.maximum(WINDOW_MM, length) / 2
    middle = (way[:-1] + way[1:]) / 2
    # A window that leaves its stroke is moved back into it.
    low = np.maximum(np.minimum(middle - half, shuts - 2 * half), opens)
    high = np.minimum(low + 2 * half, shuts)
    found: FloatArray = (np.interp(high, way, dosed) - np.interp(low, way, dosed)) / (high - low)
    return found


def _dot(pushed: FloatArray, stroke: IntArray) -> FloatArray:
    """√(4 E / π) of each move's whole stroke: width of a dot of all its ink, per √(µL/mm / h).

    A stroke shorter than it is wide is a dot: no line is wider than that.
    """
    dosed = np.concatenate([[0.0], np.cumsum(pushed)])
    opens = dosed[np.searchsorted(stroke, stroke, side="left")]
    shuts = dosed[np.searchsorted(stroke, stroke, side="right")]
    found: FloatArray = np.sqrt(4.0 / np.pi * (shuts - opens))
    return found
