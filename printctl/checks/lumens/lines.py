"""Printed lines and filaments of a G-code file, from its writing moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from firmware_profiles.materials.bead import BeadSection
from gcode.deposit.written import Strands
from gcode.program.gcode import read_gcode
from gcode.program.read_program import plain_lines, read_comments
from kernels.arrays import FloatArray, IntArray, split_rows
from printctl.checks.lumens.written_moves import origin, plunger_strokes
from printctl.errors import UsageError
from printctl.rounding import last_digit_mm, window_mm

LEVEL_TOLERANCE_MM: Final = 5e-3
FLAT_MM: Final = 1e-3


def check_level(begin: FloatArray, end: FloatArray, line: IntArray) -> None:
    """Refuse lines (n, 3) that aren't level."""
    tilted = np.flatnonzero(np.abs(end[:, 2] - begin[:, 2]) > FLAT_MM)
    if len(tilted):
        k = tilted[0]
        raise UsageError(
            f"line {line[k]} writes from z {begin[k, 2]:g} to {end[k, 2]:g} mm "
            f"({len(tilted)} such lines): these are no level layers; of an embedded print say "
            "--embedded, a spiral can't be read"
        )


def check_width(width: FloatArray, line: IntArray) -> None:
    """Refuse widths of a wrong unit or bore: every lumen would be wrong with them."""
    middle = float(np.median(width))
    if not 5e-3 <= middle <= 10.0:
        k = int(np.argmin(np.abs(width - middle)))
        raise UsageError(
            f"lines would be {1e3 * middle:.3g} µm wide (median; so line {line[k]}), which is "
            "outside 5 to 10000 µm; check what E means: the syringe or the filament's diameter, "
            "of a pneumatic head its flow"
        )


@dataclass(frozen=True)
class LayerHeightComments:
    """Heights of layers that a file's comments say (``;HEIGHT:0.06``).

    Attributes
    ----------
    line : (h,) int64
        Of each comment, ascending.
    mm : (h,) float64, mm
        From there on.
    """

    line: IntArray
    mm: FloatArray

    def of(self, lines: IntArray) -> FloatArray:
        """What is said of each line of the file, (n,), mm; NaN before the first comment."""
        if not len(self.line):
            return np.full(len(lines), np.nan)
        at = np.searchsorted(self.line, lines) - 1
        return np.where(at >= 0, self.mm[np.maximum(at, 0)], np.nan)


def comment_heights(gcode: bytes) -> LayerHeightComments:
    """Read a file's comments."""
    comments = read_comments(plain_lines(gcode))
    return LayerHeightComments(comments.height_lines, comments.height_mm)


def slabs(
    height: FloatArray, layer_mm: float | None, said_mm: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Slab of each level, and each line's level.

    A slab reaches down to the level below. The lowest, and one that hangs above the last, is as
    thick as ``layer_mm``, as the file says of it, or as the most frequent one.

    Parameters
    ----------
    height : (n,) float64, mm
        Of each line.
    layer_mm : float or None, mm
        What the user says; it counts above what the file says.
    said_mm : (n,) float64 or None, mm
        What the file says of each line; NaN for nothing.
    """
    ordered = np.unique(np.round(height, 4))
    new = np.concatenate([[True], np.diff(ordered) > LEVEL_TOLERANCE_MM])
    high = ordered[new]
    gaps = np.diff(high)
    layer = np.searchsorted(high, height + LEVEL_TOLERANCE_MM, side="right") - 1
    if layer_mm is None and said_mm is not None and not np.isnan(said_mm).any():
        commented = np.array([np.median(own) for own in _of_each(said_mm, layer, len(high))])
        below = np.concatenate([[np.inf], gaps])
        thick = np.where(below > commented + LEVEL_TOLERANCE_MM, commented, below)
        return high - thick, high, layer.astype(np.int64)
    if layer_mm is None and len(gaps) == 0:
        raise UsageError("the G-code has one layer, whose thickness is unknown; give --layer-um")
    if layer_mm is None:
        values, counts = np.unique(np.round(gaps, 3), return_counts=True)
        layer_mm = float(values[counts.argmax()])
    thick = np.concatenate([[layer_mm], np.where(gaps > 1.5 * layer_mm, layer_mm, gaps)])
    return high - thick, high, layer.astype(np.int64)


def _of_each(values: FloatArray, group: IntArray, count: int) -> list[FloatArray]:
    """Values of each group, of which none is empty."""
    order = np.argsort(group, kind="stable")
    return np.split(values[order], np.searchsorted(group[order], np.arange(1, count)))


def dose_per_mm(
    length: FloatArray, dose: FloatArray, stroke: IntArray, window_mm: float
) -> FloatArray:
    """Dose per mm of way, (n,), over ``window_mm`` about each move's middle, within its stroke.

    Parameters
    ----------
    length, dose : (n,) float64
        Of each move, mm and any unit.
    stroke : (n,) int64
        Ascending: which unbroken line each move is of.
    window_mm : float, mm
        A longer move is a window of its own.
    """
    way = np.concatenate([[0.0], np.cumsum(length)])
    dosed = np.concatenate([[0.0], np.cumsum(dose)])
    opens = way[np.searchsorted(stroke, stroke, side="left")]
    shuts = way[np.searchsorted(stroke, stroke, side="right")]
    half = np.maximum(window_mm, length) / 2
    middle = (way[:-1] + way[1:]) / 2
    # A window that leaves its stroke is moved back into it.
    low = np.maximum(np.minimum(middle - half, shuts - 2 * half), opens)
    high = np.minimum(low + 2 * half, shuts)
    doses: FloatArray = (np.interp(high, way, dosed) - np.interp(low, way, dosed)) / (high - low)
    return doses


def dots(dose: FloatArray, stroke: IntArray) -> FloatArray:
    """√(4 V / π) of each move's whole stroke: width of a dot of all its ink, times √thickness.

    A stroke shorter than it is wide is a dot: no line is wider than that.
    """
    dosed = np.concatenate([[0.0], np.cumsum(dose)])
    opens = dosed[np.searchsorted(stroke, stroke, side="left")]
    shuts = dosed[np.searchsorted(stroke, stroke, side="right")]
    widths: FloatArray = np.sqrt(4.0 / np.pi * (shuts - opens))
    return widths


ROUNDED: Final = BeadSection()
MOST_WINDOW_MM: Final = 1.0
LEAST_WINDOW_MM: Final = 0.1
"""Shorter moves are merged by the firmware."""
SURER: Final = 8.0
"""A lumen is as narrow as its widest line: doses to 0.25 %, where 2 % do for a picture."""
WINDOWLESS_MM: Final = 1e-9
"""No window: what each move doses is known exactly."""


@dataclass(frozen=True)
class WrittenLines:
    """What is written, in the printer's frame.

    Attributes
    ----------
    start, end : (n, 2) float64, mm
    width : (n,) float64, mm
        Of its cross-section's model, where it is widest.
    mean : (n,) float64, mm
        Over its height: cross-section by thickness of the layer.
    layer : (n,) int64
        From 0 for the lowest.
    low, high : (k,) float64, mm
        Of each layer's slab; the tip stands at its top.
    line : (n,) int64
        Line of the file, from 1.
    doubt_mm : tuple of float, mm
        How much wider and narrower lines may be where no bead was measured: the median one's as
        an ellipse, and as a rectangle.
    """

    start: FloatArray
    end: FloatArray
    width: FloatArray
    mean: FloatArray
    layer: IntArray
    low: FloatArray
    high: FloatArray
    line: IntArray
    doubt_mm: tuple[float, float] = (0.0, 0.0)

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
    bead: BeadSection = ROUNDED,
) -> WrittenLines:
    """Read what any slicer's G-code writes in layers.

    A line's cross-section is its volume over its length; ``bead`` says how wide that is.

    Parameters
    ----------
    gcode : bytes
    ul_per_e : float or None, µL/mm
        Volume per unit of E: the plunger's or filament's cross-section, mm². None where
        ``line_mm`` says how wide lines are.
    line_mm : float or None, mm
        Width of every line, whatever E says.
    layer_mm : float or None, mm
        Thickness of the lowest layer and of those with nothing right below; None takes what the
        file says (``;HEIGHT:``), else the most frequent one.
    bead : BeadSection

    Raises
    ------
    UsageError
        When nothing is written, writing isn't in level layers, or the widths are impossible.
    GcodeError
        When the bytes aren't text.
    """
    if line_mm is None and ul_per_e is None:
        raise UsageError("what one E means isn't known; give a syringe, a filament or line widths")
    program = read_gcode(gcode)
    strokes = plunger_strokes(program, 1.0 if ul_per_e is None else ul_per_e)
    if len(strokes.line) == 0:
        raise UsageError("no move of the G-code pushes ink while it goes sideways; is E in it?")
    window = flow_window(program.plunger, strokes, 1.0 if ul_per_e is None else ul_per_e)
    heights = comment_heights(gcode)
    lines = layered(
        strokes.moved(origin(program, gcode)), layer_mm, window, [bead], comments=heights
    )
    if line_mm is not None:
        width, thick = np.full(len(lines), line_mm), (lines.high - lines.low)[lines.layer]
        lines = replace(lines, width=width, mean=bead.area(width, thick) / thick)
    check_width(lines.width, lines.line)
    return lines


def flow_window(plunger: FloatArray, strokes: Strands, ul_per_e: float) -> float:
    """Way over which the digits that the file gives E average out, mm: none for digits enough."""
    way = float(strokes.length.sum())
    area = float(strokes.dose_ul.sum()) / way if way > 0 else 0.0
    window = SURER * window_mm(last_digit_mm(plunger) * ul_per_e, area)
    return min(max(window, LEAST_WINDOW_MM), MOST_WINDOW_MM)


def rounded_to_steps(
    lines: WrittenLines,
    steps_per_mm: tuple[float, float],
    offset_mm: FloatArray | None = None,
) -> WrittenLines:
    """The same lines between the whole motor steps of x and y; widths stay.

    Parameters
    ----------
    lines : WrittenLines
    steps_per_mm : tuple, 1/mm
    offset_mm : (n, 2) float64 or None, mm
        Of each line's tip from the place that the motors hold, where these differ.
    """
    steps = np.array(steps_per_mm)
    off = 0.0 if offset_mm is None else offset_mm
    return replace(
        lines,
        start=np.rint((lines.start - off) * steps) / steps + off,
        end=np.rint((lines.end - off) * steps) / steps + off,
    )


def layered(
    strokes: Strands,
    layer_mm: float | None,
    window_mm: float,
    beads: Sequence[BeadSection] = (ROUNDED,),
    head: IntArray | None = None,
    comments: LayerHeightComments | None = None,
) -> WrittenLines:
    """Strokes as lines in level layers; see `read_lines`.

    Parameters
    ----------
    strokes : Strands
    layer_mm : float or None, mm
    window_mm : float, mm
    beads : sequence of BeadSection
        Of each head.
    head : (n,) int64 or None
        Of each stroke; None where one head writes all.
    comments : LayerHeightComments or None
        Heights that the file says.

    Raises
    ------
    UsageError
        When one isn't level, or one layer alone doesn't say its thickness.
    """
    begin, end = strokes.start, strokes.end
    check_level(begin, end, strokes.line)
    low, high, layer = slabs(
        end[:, 2], layer_mm, None if comments is None else comments.of(strokes.line)
    )
    thick = (high - low)[layer]
    length = np.hypot(*(end - begin)[:, :2].T)
    area = dose_per_mm(length, strokes.dose_ul, strokes.stroke, window_mm)
    width = _widths(area, thick, beads, np.zeros(len(area), np.int64) if head is None else head)
    width = np.minimum(width, dots(strokes.dose_ul, strokes.stroke) / np.sqrt(thick))
    return WrittenLines(
        np.ascontiguousarray(begin[:, :2]),
        np.ascontiguousarray(end[:, :2]),
        width,
        np.minimum(area / thick, width),
        layer,
        low,
        high,
        strokes.line,
        _doubt(area, thick, width, beads),
    )


def _widths(
    area: FloatArray, thick: FloatArray, beads: Sequence[BeadSection], head: IntArray
) -> FloatArray:
    """Width of each line by its own head's bead, (n,), mm."""
    width = np.empty(len(area))
    for number, bead in enumerate(beads):
        own = head == number
        width[own] = bead.width(area[own], thick[own])
    return width


def _doubt(
    area: FloatArray, thick: FloatArray, width: FloatArray, beads: Sequence[BeadSection]
) -> tuple[float, float]:
    """How much wider and narrower lines are by the models that nobody has excluded, mm."""
    if not len(area) or not any(isinstance(bead.model, str) for bead in beads):
        return 0.0, 0.0
    wider = float(np.median(BeadSection("ellipse").width(area, thick) - width))
    narrower = float(np.median(BeadSection("rectangle").width(area, thick) - width))
    return max(wider, 0.0), min(narrower, 0.0)


THREAD_MM: Final = 1e-3
"""Thinner filaments are none."""
PIECE_DIAMETERS: Final = 1.0
LEAST_PIECE_MM: Final = 0.1


def filaments(strokes: Strands, window_mm: float) -> Strands:
    """Strokes as filaments: π d² / 4 is the dose over the way.

    Parameters
    ----------
    strokes : Strands
        Level or not.
    window_mm : float, mm
        Way over which a dose is taken, within its stroke.

    Raises
    ------
    UsageError
        When nothing is written, or the diameters are impossible.
    """
    if not len(strokes.line):
        raise UsageError("no move of the G-code pushes ink on its way; is E, or the valve, in it?")
    length = strokes.length
    area = dose_per_mm(length, strokes.dose_ul, strokes.stroke, window_mm)
    diameter = np.sqrt(4 / np.pi * np.maximum(area, 0.0))
    check_width(diameter, strokes.line)
    kept = diameter > THREAD_MM
    return Strands(
        strokes.start[kept],
        strokes.end[kept],
        strokes.dose_ul[kept],
        area[kept],
        strokes.stroke[kept],
        strokes.line[kept],
    )


def in_short_pieces(strands: Strands) -> Strands:
    """The same in pieces about as long as they are thick, to be found by their middles."""
    length = strands.length
    most = np.maximum(2 * PIECE_DIAMETERS * strands.radius, LEAST_PIECE_MM)
    count = np.maximum(np.ceil(length / most), 1).astype(np.int64)
    of, within = split_rows(count)
    way = (strands.end - strands.start)[of]
    return Strands(
        strands.start[of] + (within / count[of])[:, None] * way,
        strands.start[of] + ((within + 1) / count[of])[:, None] * way,
        (strands.dose_ul / count)[of],
        strands.area_mm2[of],
        strands.stroke[of],
        strands.line[of],
    )
