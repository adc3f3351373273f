"""Predict the deposited ink of each head from a simulated G-code file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from design.toolpath import MoveKind
from firmware_profiles import Ink, Needle, Printer, Syringe, steady_flow
from gcode.bead.flow import advance_of, cut, median_flow, nozzle_of
from gcode.bead.predict import Bead, predict_bead
from gcode.deposit.lay import Style
from gcode.deposit.written import SMOOTHING_MM, Strands
from gcode.dry_run.run import DryRun
from gcode.heads import as_plunger, flowing
from gcode.motion.executed import ExecutedMotion
from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.checks.gcode_view.line_map import LineMap
from printctl.checks.gcode_view.read import cross_sections
from printctl.checks.lumens.read import split_by_head
from printctl.checks.set_up import HeadLoading
from printctl.errors import UsageError

How = Literal["measured", "given", "unknown"]


@dataclass(frozen=True)
class ChosenLag:
    """Chosen pressure lag and its origin.

    Attributes
    ----------
    seconds : float, s
        0 where it isn't known.
    how : "measured", "given" or "unknown"
        By `printctl calibrate lag`, by the user for this once, or not at all.
    note : str
        What to tell about it; empty for a measured one.
    """

    seconds: float
    how: How
    note: str = ""


def lag_of(ink: Ink, syringe: Syringe, needle: Needle | None, given_s: float | None) -> ChosenLag:
    """Take the user's lag, else the ink's own if it was measured with this syringe and needle."""
    if given_s is not None:
        return ChosenLag(given_s, "given", f"the lag of {given_s:g} s was given, not measured here")
    own = ink.lag
    if own is None:
        return ChosenLag(
            0.0,
            "unknown",
            f"nobody measured how {ink.name}'s flow lags (printctl calibrate lag): predicted "
            "without a lag; --lag-s tries one",
        )
    mounted = (syringe.name, needle.name if needle else "no needle named")
    if (own.syringe, own.needle) != mounted:
        return ChosenLag(
            0.0,
            "unknown",
            f"the lag of {ink.name} was measured with {own.syringe} and {own.needle}, and "
            f"{mounted[0]} and {mounted[1]} are mounted: predicted without a lag; measure it again",
        )
    return ChosenLag(own.lag_s, "measured")


EXACT_MM: Final = 1e-6
"""A valve's flow is known at every moment; there are no steps to smooth."""


@dataclass(frozen=True)
class InkPrediction:
    """What one head leaves in the bath.

    Attributes
    ----------
    head : int
    mounting : HeadLoading
    bead : Bead
        With lag and advance.
    prompt : Bead
        As if the ink came at once: what the plunger pushes, without lag and advance.
    lag : ChosenLag
    advance_s : float, s
        Largest K that the firmware has in force.
    source : (n,) int64
        Layer or vessel that each of the bead's pieces is for; -1 for none. The same holds of the
        prompt one's, in `prompt_source`.
    prompt_source : (m,) int64
    of_vessels : bool or None
        What `source` counts; None where no map says it.
    ahead_s : float, s
        Lag that the file itself drives the plunger ahead of; 0 for none. The prompt bead is then
        none that anybody asks for.
    asked_mm2 : (n,) float64, mm²
        Cross-section that the file asks for in each of the bead's pieces, E over way; NaN where it
        doesn't say one: elsewhere, driven ahead of a lag, or where a valve lets the ink out.
    of_strands : bool
        Whether some vessels are written as several strands side by side.
    """

    head: int
    mounting: HeadLoading
    bead: Bead
    prompt: Bead
    lag: ChosenLag
    advance_s: float
    source: IntArray
    prompt_source: IntArray
    of_vessels: bool | None
    ahead_s: float
    asked_mm2: FloatArray
    of_strands: bool = False


def predict_job(
    run: DryRun,
    gcode: bytes,
    printer: Printer,
    mountings: Sequence[HeadLoading],
    line_map: LineMap | None = None,
    lag_s: float | None = None,
) -> tuple[InkPrediction, ...]:
    """Predict what each head lays.

    Parameters
    ----------
    run : DryRun
        Of the file.
    gcode : bytes
    printer : Printer
    mountings : sequence of HeadLoading
        Of each head.
    line_map : LineMap, optional
        Which lines write, and for what; without it a line writes where it pushes ink on its way.
    lag_s : float, optional, s
        Instead of the ink's own.

    Raises
    ------
    UsageError
        When nothing is written.
    ProfileError
        When a pneumatic head's pressure doesn't move its ink.
    """
    views = split_by_head(run, printer) if printer.heads else [run]
    predictions = [
        _of_head(number, view, gcode, printer, mounted, line_map, lag_s)
        for number, (view, mounted) in enumerate(zip(views, mountings, strict=True))
        if view.doses.any() and len(view.executed)
    ]
    if not any(one.prompt.writes.any() for one in predictions):
        raise UsageError(
            "no move of the G-code pushes ink on its way, so nothing would lie in the bath; does "
            "it have E, or is it another printer's (--printer)?"
        )
    style = _style(predictions)
    return tuple(one if one.bead.style == style else _restyled(one, style) for one in predictions)


def _style(predictions: Sequence[InkPrediction]) -> Style:
    """One style for all heads: layers only where all write in layers."""
    styles = {one.prompt.style for one in predictions if one.prompt.writes.any()}
    return "layered" if styles == {"layered"} else "embedded"


def _restyled(one: InkPrediction, style: Style) -> InkPrediction:
    def anew(bead: Bead) -> Bead:
        width = np.sqrt(4 / np.pi * bead.area_mm2) if style == "embedded" else bead.width_mm
        return replace(bead, style=style, width_mm=width)

    return replace(one, bead=anew(one.bead), prompt=anew(one.prompt))


def _of_head(
    number: int,
    run: DryRun,
    gcode: bytes,
    printer: Printer,
    mounted: HeadLoading,
    line_map: LineMap | None,
    lag_s: float | None,
) -> InkPrediction:
    lag = _lag(printer, mounted, lag_s)
    motion, area = _pushing(run, printer, mounted)
    advance = advance_of(run, gcode, printer) if printer.pneumatic is None else None
    ahead = advance.ahead_mm if advance is not None and advance.most_s > 0 else None
    line, writes, source = _lines(run, motion, line_map)
    smoothing = EXACT_MM if printer.pneumatic else SMOOTHING_MM
    style: Style | None = None
    section = mounted.ink.bead_section
    if line_map is not None and line_map.of_vessels:
        style = "embedded"

    def laid(seconds: float, advanced: FloatArray | None) -> tuple[Bead, IntArray]:
        pieces = cut(motion, area, advanced, lag_s=seconds)
        nozzle = nozzle_of(mounted.ink, mounted.needle, seconds, median_flow(pieces))
        bead = predict_bead(
            pieces, nozzle, line, writes, smoothing_mm=smoothing, style=style, section=section
        )
        of = source[np.maximum.accumulate(np.maximum(pieces.block, 0))]
        return bead, of

    prompt, prompt_of = laid(0.0, None)
    # Without a known lag it can't be said what an advance does; a warning tells of it.
    late, late_of = (prompt, prompt_of) if lag.seconds == 0 else laid(lag.seconds, ahead)
    of_vessels = None if line_map is None else line_map.of_vessels
    most = 0.0 if advance is None else advance.most_s
    ahead_s = 0.0 if line_map is None else line_map.lag_s
    both = (late, prompt, lag, most, late_of, prompt_of)
    of_strands = line_map is not None and line_map.strand is not None
    by_plunger = printer.pneumatic is None and ahead_s == 0
    asked = _asked(run, motion, late, area) if by_plunger else np.full(len(late), np.nan)
    return InkPrediction(number, mounted, *both, of_vessels, ahead_s, asked, of_strands)


def _asked(run: DryRun, motion: ExecutedMotion, bead: Bead, area_mm2: float) -> FloatArray:
    """E over way of each written piece's command times the plunger's area, (n,), mm².

    Over a window of `SMOOTHING_MM` at least, as the bead itself has it: short lines round E.
    """
    program = run.program
    before = program.before[:, :3]
    way = np.linalg.norm(program.target[:, :3] - before, axis=1)
    push = np.diff(program.plunger, prepend=0.0) * area_mm2
    those = np.flatnonzero((way > 1e-9) & (push > 0))
    section = np.full(len(way), np.nan)
    begins = np.diff(those, prepend=-2) != 1
    section[those] = cross_sections(way[those], push[those], begins, SMOOTHING_MM)
    row = np.minimum(np.searchsorted(program.command, motion.line), len(program) - 1)
    return np.where(bead.writes, section[row[np.maximum(bead.pieces.block, 0)]], np.nan)


def _lag(printer: Printer, mounted: HeadLoading, given_s: float | None) -> ChosenLag:
    if printer.pneumatic is None:
        return lag_of(mounted.ink, mounted.syringe, mounted.needle, given_s)
    if given_s is not None:
        raise UsageError(
            f"--lag-s: {printer.name} has a valve, whose delays its profile says "
            "(opening_delay_s, closing_delay_s); leave it out"
        )
    return ChosenLag(0.0, "unknown", "a valve's flow is taken as steady while it stands open")


def _pushing(run: DryRun, printer: Printer, mounted: HeadLoading) -> tuple[ExecutedMotion, float]:
    """Motion whose plunger pushes the ink, and µL that come out for its millimetre."""
    head = printer.pneumatic
    if head is None:
        bore = mounted.syringe.inner_mm
        return run.executed, math.pi / 4 * bore**2 * mounted.ink.flow_factor
    if run.valve is None or mounted.needle is None:
        raise UsageError(
            f"what flows out of {printer.name} follows from its needle; name it (--needle)"
        )
    flow = steady_flow(head, mounted.ink, mounted.needle).ul_s
    spans = flowing(run.executed, run.program, run.valve, head)
    return as_plunger(run.executed, spans, flow), 1.0


def _lines(
    run: DryRun, motion: ExecutedMotion, line_map: LineMap | None
) -> tuple[IntArray, BoolArray, IntArray]:
    """Of each block: line of the file, whether it is to write, and its layer or vessel."""
    program = run.program
    row = np.minimum(np.searchsorted(program.command, motion.line), len(program) - 1)
    line = np.where(motion.line >= 0, program.line[row], 0)
    writes = (motion.line >= 0) & run.doses[row]
    if line_map is None:
        return line, writes, np.full(len(line), -1, dtype=np.int64)
    at = np.clip(line - 1, 0, len(line_map.source) - 1)
    source = np.where(line > 0, line_map.source[at], -1)
    if line_map.kind is not None:
        # A compensated stroke may go on for a while with a standing plunger.
        writes = (line > 0) & (line_map.kind[at] == int(MoveKind.WRITE))
    return line, writes, source


def written_filaments(beads: Sequence[Bead]) -> Strands:
    """Convert the beads written by a file to filaments; without oozed threads and drops.

    Parameters
    ----------
    beads : sequence of Bead
        Of each head, embedded.
    """
    each = []
    for bead in beads:
        rows = np.flatnonzero(bead.writes & bead.lays)
        area = np.pi / 4 * bead.width_mm[rows] ** 2
        each.append(
            Strands(
                bead.pieces.start[rows],
                bead.pieces.end[rows],
                area * bead.pieces.length[rows],
                area,
                bead.stroke[rows],
                bead.line[rows],
            )
        )
    return Strands.joined(each)
