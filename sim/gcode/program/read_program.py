"""Read a G-code file of any firmware family: moves and refused lines."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from firmware_profiles import Printer
from firmware_profiles.families import family_of
from sim.errors import LineError
from sim.gcode.program.gcode import Program, read_gcode
from sim.gcode.reading.file import read_file
from sim.gcode.reading.line import LIMITS, NamedCommand

_SECONDS: Final = 60.0
"""The reader takes F as per minute."""


class ReadProgram(NamedTuple):
    """A file as it was read.

    Attributes
    ----------
    gcode : bytes
        What it was read from: as many lines as the file, each as it is sent.
    named : tuple of NamedCommand
        Commands with names, which the program holds as M105, T or G92.
    refused : tuple of (int, LineError)
        Lines that can't be read, which the program leaves out.
    """

    program: Program
    gcode: bytes
    named: tuple[NamedCommand, ...]
    refused: tuple[tuple[int, LineError], ...]


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
    program = read_gcode(text, start_mm, printer.head_count, rule)
    if file.per_second is not None:
        program = _timed(program, file.per_second)
    return ReadProgram(program, text, file.named, file.refused)


def _timed(program: Program, per_second: tuple[tuple[int, bool], ...]) -> Program:
    """The program with feeds in mm/s."""
    factor = np.full(len(program), _SECONDS)
    for line, seconds in per_second:
        factor[program.line > line] = _SECONDS if seconds else 1.0
    return replace(program, feed=program.feed * factor)
