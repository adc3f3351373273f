"""Read layered G-code as printed lines with width and height, each a rounded strip from above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from firmware_profiles.bead import BeadSection
from kernels.arrays import FloatArray, IntArray
from printctl.checks.lumens.line_widths import (
    LayerHeightComments,
    check_level,
    check_width,
    comment_heights,
    dose_per_mm,
    dots,
    slabs,
)
from printctl.checks.lumens.strokes import origin, plunger_strokes
from printctl.errors import UsageError
from printctl.rounding import last_digit_mm, window_mm
from sim.gcode.deposit.strands import Strands
from sim.gcode.program.gcode import read_gcode

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
