"""Read a G-code file's printed lines or filaments, and find the part's origin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from design.network import VesselNetwork
from design.solids import Solid
from design.solids.manifolds import solid_manifold
from firmware_profiles import Printer
from firmware_profiles.materials.bead import BeadSection
from gcode.deposit.written import SMOOTHING_MM, Strands
from gcode.dry_run.run import DryRun, dry_run
from gcode.heads import read_with_valve
from gcode.program.read_program import declared_start, plain_lines
from kernels.arrays import FloatArray, IntArray
from printctl.checks.lumens.lines import (
    ROUNDED,
    WINDOWLESS_MM,
    WrittenLines,
    check_width,
    comment_heights,
    filaments,
    flow_window,
    layered,
    read_lines,
    rounded_to_steps,
)
from printctl.checks.lumens.written_moves import plunger_strokes, run_strokes, valve_strokes
from printctl.errors import UsageError


def split_by_head(run: DryRun, printer: Printer) -> list[DryRun]:
    """The run as each head sees it: its rows, its blocks, its own tip's places."""
    return [
        replace(run.of_head(number), executed=run.executed.of_head(number, head.offset_mm.mm))
        for number, head in enumerate(printer.heads)
    ]


def stack_heads(each: Sequence[Strands]) -> tuple[Strands, IntArray]:
    """All heads' strokes, one head after the other, and the head of each."""
    return Strands.joined(each), np.repeat(np.arange(len(each)), [len(one) for one in each])


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
    flow_ul_s_of_heads : tuple of float, µL/s
        Of each of several pneumatic heads; ``flow_ul_s`` for all where it is empty.
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
    flow_ul_s_of_heads: tuple[float, ...] = ()


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
    views = split_by_head(_run(gcode, writing), printer)
    if printer.airs:
        return _layers_of_valves(gcode, views, writing)
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


def _layers_of_valves(
    gcode: bytes, views: Sequence[DryRun], writing: Writing
) -> tuple[WrittenLines, WrittenLines]:
    """Lines of several pneumatic heads, as written and as the dry run's motors do it."""
    strokes = _of_valves(views, writing, level=True)
    heights = comment_heights(gcode)
    beads = writing.beads * len(views) if len(writing.beads) == 1 else writing.beads
    ideal, after = (
        layered(stack, writing.layer_mm, WINDOWLESS_MM, beads, head, heights)
        for stack, head in map(stack_heads, strokes)
    )
    check_width(ideal.width, ideal.line)
    return ideal, after


def _of_valves(
    views: Sequence[DryRun], writing: Writing, *, level: bool
) -> tuple[list[Strands], list[Strands]]:
    """Strokes of each pneumatic head, as the file says and as the dry run's motors do it."""
    ideal, after = [], []
    for number, (view, flow) in enumerate(zip(views, _flows(writing), strict=True)):
        if view.valve is None or not view.valve.is_open.any():
            continue
        ideal.append(valve_strokes(view.program, view.valve, flow, level=level))
        one = writing.printer.of_head(number)
        after.append(run_strokes(view, one, 0.0, flow, level=level))
    if not any(len(one.line) for one in ideal):
        raise UsageError(_NEVER)
    return ideal, after


def _flows(writing: Writing) -> list[float]:
    """What flows out of each pneumatic head, µL/s."""
    if writing.flow_ul_s_of_heads:
        return list(writing.flow_ul_s_of_heads)
    if writing.flow_ul_s is None:
        raise UsageError(
            f"what flows while the valves of {writing.printer.name} are open isn't known; give "
            "--flow-ul-s, or --ink and --needle"
        )
    return [writing.flow_ul_s] * writing.printer.head_count


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
    ideal, after = [], []
    views = split_by_head(_run(gcode, writing), writing.printer)
    if writing.printer.airs:
        of_valves = _of_valves(views, writing, level=False)
        one, other = ([filaments(of, WINDOWLESS_MM) for of in each] for each in of_valves)
        return Strands.joined(one), Strands.joined(other)
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


TOLERANCE_MM: Final = 0.1
"""Ink and part may differ in size by this; by more, what is written isn't the part alone."""
LAYERS: Final = 60
"""Compared, evenly chosen."""


def find_place(lines: WrittenLines, part: Solid) -> FloatArray:
    """The part's origin in the printer's frame, (3,), mm: layers of ink over the part's sections.

    Median over the layers, so that one blot of ink at the rim moves nothing.

    Parameters
    ----------
    lines : WrittenLines
    part : Solid
        In its own frame, with or without its lumens.

    Raises
    ------
    UsageError
        When the sizes differ, so that something else is written too (a skirt, a purge line), or
        the part is turned or scaled.
    SolidError
        When the part isn't closed.
    """
    low, high = part.bounds
    height = float(high[2] - low[2])
    wrote = float(lines.high[-1] - lines.low[0])
    if abs(wrote - height) > float((lines.high - lines.low).max()):
        raise UsageError(
            f"ink is written over {wrote:.3f} mm of height, the part is {height:.3f} mm high: "
            f"{_REMEDY}"
        )
    z = float(lines.low[0] - low[2])
    chosen = np.unique(np.linspace(0, len(lines.low) - 1, LAYERS).round().astype(np.int64))
    asked = _sections(part, (lines.low + lines.high)[chosen] / 2 - z)
    ink = _ink(lines)[chosen]
    size, has = np.median((ink - asked)[:, 1] - (ink - asked)[:, 0], axis=0), asked[0]
    if not (np.abs(size) <= TOLERANCE_MM).all():
        here = ink[0, 1] - ink[0, 0]
        raise UsageError(
            f"ink is written over {_by(here)} mm in the lowest layer, the part there is "
            f"{_by(has[1] - has[0])} mm: {_REMEDY}"
        )
    middle = np.median((ink - asked).mean(axis=1), axis=0)
    return np.array([*middle, z])


def find_filament_place(strands: Strands, network: VesselNetwork) -> FloatArray:
    """The part's origin in the printer's frame, (3,), mm: written axes over the designed ones.

    Raises
    ------
    UsageError
        When the written box isn't as large as the network's, so that something else is written
        too, or overlaps reach beyond it.
    """
    asked = np.array([network.points.min(axis=0), network.points.max(axis=0)])
    ends = np.concatenate([strands.start, strands.end])
    wrote = np.array([ends.min(axis=0), ends.max(axis=0)])
    shift: FloatArray = wrote - asked
    if np.abs(shift[1] - shift[0]).max() > TOLERANCE_MM:
        raise UsageError(
            f"filaments are written over {_by(wrote[1] - wrote[0])} mm, the network's axes over "
            f"{_by(asked[1] - asked[0])} mm: {_REMEDY}"
        )
    place: FloatArray = shift.mean(axis=0)
    return place


_REMEDY: Final = (
    "where the part stands can't be told from that (a skirt or purge line, another part, scaled "
    "or turned); give --place X,Y,Z, the part's origin in the printer's frame"
)


def _sections(part: Solid, heights: FloatArray) -> FloatArray:
    """Bounds of the part's sections, (k, 2, 2), mm; NaN where there is none."""
    body = solid_manifold(part, "the part")
    bounds = np.full((len(heights), 2, 2), np.nan)
    for k, z in enumerate(heights):
        section = body.slice(float(z))
        if not section.is_empty():
            bounds[k] = np.reshape(section.bounds(), (2, 2))
    return bounds


def _ink(lines: WrittenLines) -> FloatArray:
    """Bounds of each layer's ink, (k, 2, 2), mm."""
    half = lines.width[:, None] / 2
    order: IntArray = np.argsort(lines.layer, kind="stable").astype(np.int64)
    first = np.searchsorted(lines.layer[order], np.arange(len(lines.low)))
    low = (np.minimum(lines.start, lines.end) - half)[order]
    high = (np.maximum(lines.start, lines.end) + half)[order]
    return np.stack([np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)], axis=1)


def _by(size: FloatArray) -> str:
    return " x ".join(f"{value:.3f}" for value in size)
