"""Read a G-code file of any firmware family: moves, refused lines, slicer comments, start."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Printer
from firmware_profiles.families import family_of
from gcode.errors import LineError
from gcode.program.gcode import Program, read_gcode
from gcode.program.valve import (
    idle_outside,
    read_lifts,
    read_valves,
    with_heads,
    with_other_axes,
)
from gcode.reading import read_line
from gcode.reading.file import GcodeFile, read_file
from gcode.reading.line import LIMITS
from kernels.arrays import FloatArray, IntArray

_SECONDS: Final = 60.0
"""The reader takes F as per minute."""


class ReadProgram(NamedTuple):
    """A file as it was read.

    Attributes
    ----------
    gcode : bytes
        What it was read from: as many lines as the file, each as it is sent.
    file : GcodeFile
        Its commands with names the program holds as M105, T or G92; it leaves out refused lines.
    axis_mm : (n, heads) float64 or None, mm
        Where each head's own vertical axis stands after each row; None where all share one.
    """

    program: Program
    gcode: bytes
    file: GcodeFile
    axis_mm: FloatArray | None = None


def read_written(
    gcode: bytes,
    printer: Printer,
    start_mm: tuple[float, float, float],
    *,
    max_refused: int = LIMITS.max_refused,
) -> ReadProgram:
    """Read a file.

    Parameters
    ----------
    start_mm : tuple, mm
        Where the tip stands before the first line.
    max_refused : int
        As for `read_file`.

    Raises
    ------
    GcodeError
        When the bytes aren't text, or the profile doesn't say in which language they are.
    """
    file = read_file(gcode, printer, max_refused=max_refused)
    text = file.in_g_code
    rule = family_of(printer).grammar.e_rule
    program = read_gcode(text, start_mm, printer.tool_count, rule)
    if file.per_second is not None:
        program = _timed(program, file.per_second)
    if len(printer.airs) < 2:
        return ReadProgram(program, text, file)
    # No command says which head is in use: its valve does.
    files, axis_mm = [file], np.repeat(program.target[:, 2:3], printer.head_count, axis=1)
    own_axes = len(set(printer.z_axes)) > 1
    if own_axes:
        files = [
            read_file(gcode, printer, head=k, max_refused=max_refused)
            for k in range(printer.head_count)
        ]
        each = [_heights(read_gcode(one.in_g_code, start_mm), program) for one in files]
        axis_mm = np.column_stack(each)
    lifts = [head.raised_mm for head in printer.heads or ()]
    lifted_mm = read_lifts(program, file.others, printer)[0] * np.array(lifts)
    valves = read_valves(program, file.others, printer)
    program, uneven = with_heads(program, axis_mm, lifted_mm, valves)
    if own_axes:
        uneven += idle_outside(program, axis_mm, printer)
        program = with_other_axes(program, axis_mm, printer)
    refused = dict(pair for one in files[::-1] for pair in one.refused) | dict(uneven)
    file = replace(file, refused=tuple(sorted(refused.items())))
    return ReadProgram(program, text, file, axis_mm)


def _heights(of_head: Program, program: Program) -> FloatArray:
    """Height of one head's axis after each row of the program; refused lines may differ."""
    last = np.searchsorted(of_head.line, program.line, side="right")
    return np.append(of_head.start[2], of_head.target[:, 2])[last]


def _timed(program: Program, per_second: tuple[tuple[int, bool], ...]) -> Program:
    """The program with feeds in mm/s."""
    factor = np.full(len(program), _SECONDS)
    for line, seconds in per_second:
        factor[program.line > line] = _SECONDS if seconds else 1.0
    return replace(program, feed=program.feed * factor)


_KIND: Final = re.compile(rb";[ ]*(?:TYPE:|FEATURE:|feature )[ ]*(.*?)[ ]*\Z")
_HEIGHT: Final = re.compile(rb";[ ]*(?:HEIGHT:|LAYER_HEIGHT:)[ ]*(\d*\.?\d+)")
_LAYER: Final = re.compile(rb";[ ]*(?:LAYER_CHANGE|CHANGE_LAYER|LAYER:\d+)")
_FILAMENT: Final = re.compile(rb";[ ]*filament_diameter[ ]*[=:][ ]*(\d*\.?\d+)")
_BEFORE_MOVING: Final = 200


def plain_lines(gcode: bytes) -> bytes:
    """Return the lines ended by a line feed; a carriage return ends one, too."""
    if b"\r" not in gcode:
        return gcode
    return gcode.replace(b"\r\n", b"\n").replace(b"\r", b"\n")


@dataclass(frozen=True, eq=False)
class Comments:
    """Facts read from slicer comments.

    Attributes
    ----------
    kind_lines, kind : (k,) int64
        Line of each comment and the place in `kinds` of what it says.
    height_lines : (h,) int64
    height_mm : (h,) float64, mm
        Of the layer that begins there.
    layer_lines : (m,) int64
        Where a new layer begins.
    filament_mm : float or None, mm
        Diameter that the slicer counts E in.
    """

    kind_lines: IntArray
    kind: IntArray
    kinds: tuple[str, ...]
    height_lines: IntArray
    height_mm: NDArray[np.float64]
    layer_lines: IntArray
    filament_mm: float | None


def read_comments(text: bytes) -> Comments:
    """Read a file of `plain_lines`."""
    kinds: dict[str, int] = {}
    kind: list[tuple[int, int]] = []
    heights: list[tuple[int, float]] = []
    layers: list[int] = []
    filament_mm = None
    for line, comment in _comments(text):
        if match := _KIND.match(comment):
            name = match[1].decode("utf-8", "replace") or "no name"
            kind.append((line, kinds.setdefault(name, len(kinds))))
        elif match := _HEIGHT.match(comment):
            heights.append((line, float(match[1])))
        elif _LAYER.match(comment):
            layers.append(line)
        elif filament_mm is None and (match := _FILAMENT.match(comment)):
            filament_mm = float(match[1])
    return Comments(
        kind_lines=np.array([line for line, _ in kind], np.int64),
        kind=np.array([which for _, which in kind], np.int64),
        kinds=tuple(kinds),
        height_lines=np.array([line for line, _ in heights], np.int64),
        height_mm=np.array([height for _, height in heights]),
        layer_lines=np.array(layers, np.int64),
        filament_mm=filament_mm or None,
    )


def _comments(text: bytes) -> Iterator[tuple[int, bytes]]:
    """Lines that are nothing else, with their numbers from 1; lines of moves aren't looked at."""
    line, counted = 1, 0
    at = 0 if text.startswith(b";") else _next_comment(text, 0)
    while at >= 0:
        line, counted = line + text.count(b"\n", counted, at), at
        end = text.find(b"\n", at)
        yield line, text[at : end if end >= 0 else None]
        at = _next_comment(text, at)


def _next_comment(text: bytes, at: int) -> int:
    """Where the next line begins that is one; -1 for nowhere."""
    place = text.find(b"\n;", at)
    return place + 1 if place >= 0 else -1


def declared_start(text: bytes, printer: Printer) -> tuple[float, float, float] | None:
    """Where the file itself says that the tip stands before it moves (G92 X Y Z), mm."""
    for line in text[: 100 * _BEFORE_MOVING].split(b"\n")[:_BEFORE_MOVING]:
        try:
            read = read_line(line, printer)
        except LineError:
            continue
        if read.code in ("G0", "G1", "G2", "G3", "G28", "G20"):
            return None
        x, y, z = (read.number(axis) for axis in "XYZ")
        if read.code == "G92" and x is not None and y is not None and z is not None:
            return x, y, z
    return None
