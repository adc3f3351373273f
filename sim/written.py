"""A file as its printer's family writes it, read by the one G-code reader."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from firmware_profiles import Printer
from sim.dialect_aerotech import Written, translated
from sim.errors import GcodeError
from sim.gcode import Program, read_gcode
from sim.gcode_extended import Named, without_names

_SECONDS: Final = 60.0
"""The reader takes F as per minute."""


def read_written(
    gcode: bytes, printer: Printer, start_mm: tuple[float, float, float]
) -> tuple[Program, bytes, tuple[Named, ...]]:
    """Read a file.

    Parameters
    ----------
    gcode : bytes
    printer : Printer
    start_mm : tuple, mm
        Where the tip stands before the first line.

    Returns
    -------
    Program
    bytes
        What it was read from: as many lines as ``gcode``.
    tuple of Named
        Commands with names, which the program holds as M105 or G92.

    Raises
    ------
    GcodeError
        When the bytes aren't text, or the profile doesn't say which Aerotech controller it is for.
    """
    if printer.firmware == "aerotech":
        if printer.aerotech is None:
            raise GcodeError(
                f"{printer.name} doesn't say which controller it is (aerotech: controller)"
            )
        written = translated(gcode, printer.aerotech)
        program = read_gcode(written.gcode, start_mm, printer.head_count)
        return _timed(program, written), written.gcode, written.named
    named: tuple[Named, ...] = ()
    if printer.firmware == "klipper":
        gcode, named = without_names(gcode)
    return read_gcode(gcode, start_mm, printer.head_count), gcode, named


def _timed(program: Program, written: Written) -> Program:
    """The program with feeds in mm/s."""
    factor = np.full(len(program), _SECONDS)
    for line, seconds in written.per_second:
        factor[program.line > line] = _SECONDS if seconds else 1.0
    return replace(program, feed=program.feed * factor)
