"""Compute which lines should lie in the bath after so many commands of a job.

From the job's file alone, by the readers and bead models that lumens are predicted by: on a real
machine nothing else is known, and the link proves that these lines were executed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from printctl.lumens.lines import WrittenLines
from printctl.lumens.read import Writing, read_filaments, read_layers
from sim.deposit.strands import Strands
from sim.program.gcode import Program, read_gcode

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_SAME_MM: Final = 1e-6
"""A piece that begins so near to the last one's end goes on with its path."""


@dataclass(frozen=True)
class ExpectedInk:
    """Straight pieces of written ink, in the order of writing, printer's frame.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
        Of the tip.
    width_mm : (n,) float64, mm
        Of a line in a layer, or diameter of a filament.
    height_mm : (n,) float64, mm
        Thickness of the layer, or the diameter again.
    area_mm2 : (n,) float64, mm²
        Cross-section.
    command : (n,) int64
        Command of the job, from 0.
    stroke : (n,) int64
        Ascending: unbroken path of each.
    time_s : (n,) float64, s
        Of its middle, by the speeds that the job asks for, from the job's first line.
    style : "layered" or "embedded"
    """

    start: FloatArray
    end: FloatArray
    width_mm: FloatArray
    height_mm: FloatArray
    area_mm2: FloatArray
    command: IntArray
    stroke: IntArray
    time_s: FloatArray
    style: Literal["layered", "embedded"]

    def __len__(self) -> int:
        return len(self.command)

    @property
    def length_mm(self) -> FloatArray:
        """Way of each piece, (n,), mm."""
        return np.asarray(np.linalg.norm(self.end - self.start, axis=1))

    @property
    def volume_ul(self) -> FloatArray:
        """Ink of each piece, (n,), µL."""
        return self.area_mm2 * self.length_mm

    def between(self, first: int, last: int) -> BoolArray:
        """Which pieces the commands ``first`` up to, not including, ``last`` write, (n,)."""
        return (self.command >= first) & (self.command < last)


def expected_ink(gcode: bytes, writing: Writing, *, embedded: bool) -> ExpectedInk:
    """Return all ink of a job.

    Parameters
    ----------
    gcode : bytes
        The file.
    writing : Writing
        How its moves become ink.
    embedded : bool
        Whether it writes filaments into a bath; else layers.

    Raises
    ------
    UsageError
        When nothing is written, or not in the way said.
    """
    program = read_gcode(gcode)
    if embedded:
        return _filaments(read_filaments(gcode, writing)[0], program)
    return _lines(read_layers(gcode, writing)[0], program)


def _lines(lines: WrittenLines, program: Program) -> ExpectedInk:
    top, thick = lines.high[lines.layer], (lines.high - lines.low)[lines.layer]
    start, end = np.column_stack([lines.start, top]), np.column_stack([lines.end, top])
    return _in_order(
        start, end, lines.width, thick, lines.mean * thick, lines.line, program, "layered"
    )


def _filaments(found: Strands, program: Program) -> ExpectedInk:
    wide = 2.0 * found.radius
    return _in_order(
        found.start, found.end, wide, wide, found.area_mm2, found.line, program, "embedded"
    )


def _in_order(
    start: FloatArray,
    end: FloatArray,
    width: FloatArray,
    height: FloatArray,
    area: FloatArray,
    line: IntArray,
    program: Program,
    style: Literal["layered", "embedded"],
) -> ExpectedInk:
    order = np.argsort(line, kind="stable")
    start, end, line = start[order], end[order], line[order]
    row = np.minimum(np.searchsorted(program.line, line), len(program) - 1)
    apart = np.linalg.norm(start[1:] - end[:-1], axis=1) > _SAME_MM
    stroke = np.concatenate([[0], np.cumsum(apart)]).astype(np.int64)
    return ExpectedInk(
        start,
        end,
        width[order],
        height[order],
        area[order],
        program.command[row],
        stroke[: len(line)],
        _times(program)[row],
        style,
    )


def _times(program: Program) -> FloatArray:
    """Middle of each row, s, at the speed asked for; dwells and acceleration don't count."""
    before = np.concatenate([program.start[None, :], program.target[:-1]])
    moved = program.target - before
    way = np.linalg.norm(moved[:, :3], axis=1)
    way = np.where(way > 0, way, np.abs(moved[:, 3]))
    seconds = np.divide(way, program.feed, out=np.zeros_like(way), where=program.feed > 0)
    return np.asarray(np.cumsum(seconds) - seconds / 2)
