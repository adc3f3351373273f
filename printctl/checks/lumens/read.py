"""Read the printed lines or filaments of a G-code file, nominal and rounded to motor steps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from firmware_profiles import Printer
from firmware_profiles.bead import BeadSection
from kernels.arrays import FloatArray
from printctl.checks.lumens.filaments import filaments
from printctl.checks.lumens.heads import split_by_head, stack_heads
from printctl.checks.lumens.line_widths import check_width, comment_heights
from printctl.checks.lumens.lines import (
    ROUNDED,
    WINDOWLESS_MM,
    WrittenLines,
    flow_window,
    layered,
    read_lines,
    rounded_to_steps,
)
from printctl.checks.lumens.strokes import plunger_strokes, run_strokes, valve_strokes
from printctl.errors import UsageError
from sim.gcode.deposit.strands import Strands
from sim.gcode.dry_run.run import DryRun, dry_run
from sim.gcode.heads import read_with_valve
from sim.gcode.reading.comments import declared_start, plain_lines

SMOOTHING_MM: Final = 1.0
"""Ink and syringe give way, so that single steps of the plunger are smoothed over this way."""

Place = tuple[float, float, float]


@dataclass(frozen=True)
class Writing:
    """How a file's moves become ink.

    Attributes
    ----------
    printer : Printer
        Whose head writes, and whose steps and planner are taken.
    ul_per_e : float or None, µL/mm
        Of a plunger or filament; None for a pneumatic head, or where ``line_mm`` says all.
    ul_per_e_of_heads : tuple of float, µL/mm
        Of each of several heads' plungers; ``ul_per_e`` for all where it is empty.
    flow_ul_s : float or None, µL/s
        Of a pneumatic head while its valve is open.
    line_mm : float or None, mm
        Width of every line, whatever E says; layers only.
    layer_mm : float or None, mm
        Thickness of layers, as for `read_lines`.
    beads : tuple of BeadSection
        Cross-section of each head's lines; one for all where there is but one.
    start_mm : tuple or None, mm
        Where the tip stands before the first line; None takes what the file says.
    """

    printer: Printer
    ul_per_e: float | None = None
    flow_ul_s: float | None = None
    line_mm: float | None = None
    layer_mm: float | None = None
    beads: tuple[BeadSection, ...] = (ROUNDED,)
    start_mm: Place | None = None
    ul_per_e_of_heads: tuple[float, ...] = ()


def read_layers(gcode: bytes, writing: Writing) -> tuple[WrittenLines, WrittenLines]:
    """Lines in level layers, as written and after motor steps.

    Of a plunger the steps are those of x and y; a valve's lines are those of the dry run, which
    lays more where the head slows down.

    Raises
    ------
    UsageError
        When nothing is written, not in level layers, or the widths are impossible.
    GcodeError
        When the bytes aren't text.
    """
    printer = writing.printer
    if printer.heads:
        return _layers_of_heads(gcode, writing)
    if printer.pneumatic is None:
        lines = read_lines(
            gcode,
            writing.ul_per_e,
            line_mm=writing.line_mm,
            layer_mm=writing.layer_mm,
            bead=writing.beads[0],
        )
        return lines, rounded_to_steps(lines, (printer.steps_per_mm.x, printer.steps_per_mm.y))
    ideal, run = _strokes(gcode, writing, level=True)
    if not len(ideal.line):
        raise UsageError(_NEVER)
    stepped = run_strokes(run, printer, 0.0, writing.flow_ul_s)
    heights = comment_heights(gcode)
    both = (
        layered(ideal, writing.layer_mm, WINDOWLESS_MM, writing.beads, comments=heights),
        layered(stepped, writing.layer_mm, WINDOWLESS_MM, writing.beads, comments=heights),
    )
    check_width(both[0].width, both[0].line)
    return both


def _layers_of_heads(gcode: bytes, writing: Writing) -> tuple[WrittenLines, WrittenLines]:
    """Lines of all heads at their own tips' places."""
    printer, each = writing.printer, []
    run = _run(gcode, writing)
    views = split_by_head(run, printer)
    for view, ul_per_e in zip(views, _per_e(writing), strict=True):
        each.append(plunger_strokes(view.program, ul_per_e))
    strokes, head = stack_heads(each)
    if not len(strokes.line):
        raise UsageError("no move of the G-code pushes ink while it goes sideways; is E in it?")
    beads = writing.beads * len(each) if len(writing.beads) == 1 else writing.beads
    window = max(
        flow_window(view.program.plunger, one, per_e)
        for view, one, per_e in zip(views, each, _per_e(writing), strict=True)
    )
    lines = layered(strokes, writing.layer_mm, window, beads, head, comment_heights(gcode))
    if writing.line_mm is not None:
        lines = replace(lines, width=np.full(len(lines), writing.line_mm))
    check_width(lines.width, lines.line)
    offset = np.array([one.offset_mm.mm for one in printer.heads])[head, :2]
    steps = (printer.steps_per_mm.x, printer.steps_per_mm.y)
    return lines, rounded_to_steps(lines, steps, offset)


def _per_e(writing: Writing) -> list[float]:
    """What a millimetre of each head's plunger pushes, µL."""
    if writing.ul_per_e_of_heads:
        return list(writing.ul_per_e_of_heads)
    if writing.ul_per_e is None and writing.line_mm is None:
        raise UsageError("what one E means isn't known; give a syringe, a filament or line widths")
    one = 1.0 if writing.ul_per_e is None else writing.ul_per_e
    return [one] * writing.printer.head_count


_NEVER: Final = (
    "no move of the G-code goes sideways with the valve open; is it this printer's file "
    "(--printer)?"
)


def read_filaments(gcode: bytes, writing: Writing) -> tuple[Strands, Strands]:
    """Filaments written into a bath, as the file says and as the dry run's motors do it.

    After motor steps places are whole steps of x, y and z, and the plunger's whole steps are
    smoothed over `SMOOTHING_MM`.

    Raises
    ------
    UsageError
        When nothing is written, or the diameters are impossible.
    GcodeError
        When the bytes aren't text.
    """
    if writing.printer.heads:
        return _filaments_of_heads(gcode, writing)
    ideal, run = _strokes(gcode, writing, level=False)
    per_mm = writing.ul_per_e or 0.0
    stepped = run_strokes(run, writing.printer, per_mm, writing.flow_ul_s, level=False)
    if writing.flow_ul_s is not None:
        return filaments(ideal, WINDOWLESS_MM), filaments(stepped, WINDOWLESS_MM)
    window = flow_window(run.program.plunger, ideal, per_mm)
    return filaments(ideal, window), filaments(stepped, SMOOTHING_MM)


def _filaments_of_heads(gcode: bytes, writing: Writing) -> tuple[Strands, Strands]:
    """Filaments of all heads at their own tips' places."""
    run, ideal, after = _run(gcode, writing), [], []
    views = split_by_head(run, writing.printer)
    for number, (view, per_mm) in enumerate(zip(views, _per_e(writing), strict=True)):
        strokes = plunger_strokes(view.program, per_mm, level=False)
        if not len(strokes.line):
            continue
        ideal.append(filaments(strokes, flow_window(view.program.plunger, strokes, per_mm)))
        printer = writing.printer.of_head(number)
        stepped = run_strokes(view, printer, per_mm, None, level=False)
        after.append(filaments(stepped, SMOOTHING_MM))
    if not ideal:
        raise UsageError("no move of the G-code pushes ink on its way; is E in it?")
    return Strands.joined(ideal), Strands.joined(after)


def writes_at(gcode: bytes, writing: Writing) -> tuple[FloatArray, FloatArray]:
    """Where each move that writes begins and ends, (n, 3) each, mm, without a dry run."""
    text, printer = plain_lines(gcode), writing.printer
    program, valve = read_with_valve(text, printer, writing.start_mm or (0.0, 0.0, 0.0))
    if valve is None:
        strokes = plunger_strokes(program, 1.0, level=False)
    else:
        strokes = valve_strokes(program, valve, 1.0, level=False)
    return strokes.start, strokes.end


def _strokes(gcode: bytes, writing: Writing, *, level: bool) -> tuple[Strands, DryRun]:
    """What the file says, and its dry run."""
    text, printer = plain_lines(gcode), writing.printer
    start = _start(text, writing)
    program, valve = read_with_valve(text, printer, start)
    run = _run(gcode, writing)
    if valve is not None:
        if writing.flow_ul_s is None:
            raise UsageError(
                f"what flows while the valve of {printer.name} is open isn't known; give "
                "--flow-ul-s, or --ink and --needle"
            )
        return valve_strokes(program, valve, writing.flow_ul_s, level=level), run
    if writing.ul_per_e is None:
        raise UsageError("what one E means isn't known; give a syringe or a filament")
    return plunger_strokes(program, writing.ul_per_e, level=level), run


def _start(text: bytes, writing: Writing) -> Place:
    return writing.start_mm or declared_start(text, writing.printer) or (0.0, 0.0, 0.0)


def _run(gcode: bytes, writing: Writing) -> DryRun:
    text = plain_lines(gcode)
    return dry_run(text, writing.printer, _start(text, writing), cold_extrusion=True)
