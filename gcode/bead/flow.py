"""Compute the needle's ink outflow exactly, from plunger motion of piecewise constant speed.

Within a piece the plunger goes evenly, so the compliance's equation (`gcode.bead.flow`) has
its own solution: V − V_y − τ Q_p falls off as e^(−t/τ) while ink flows; while |V| ≤ V_y nothing
flows and V goes with the plunger. There are no time steps. Below −V_y the plunger's pull draws ink
back into the needle by the same law (a retraction); what comes out next is that ink.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from firmware_profiles import Ink, Needle, Printer, pressure_pa, yield_pressure_pa
from firmware_profiles.families import family_of
from gcode.dry_run.run import DryRun
from gcode.motion.executed import ExecutedMotion
from gcode.program.gcode import Program
from kernels.arrays import FloatArray, IntArray, split_rows


@dataclass(frozen=True)
class NozzleFlow:
    """Outflow of the needle in each piece of motion.

    Attributes
    ----------
    out_ul : (n,) float64, µL
        Out of the needle; below 0 where it is drawn back.
    laid_ul : (n,) float64, µL
        Ink that is laid: what goes out beyond what had been out before.
    held_ul : (n,) float64, µL
        Held back by compliance as the piece ends, V.
    start_ul : float, µL
        V before the first piece.
    """

    out_ul: FloatArray
    laid_ul: FloatArray
    held_ul: FloatArray
    start_ul: float


def nozzle_flow(pieces: Pieces, nozzle: Nozzle) -> NozzleFlow:
    """Integrate over all pieces.

    The needle is full and primed when the motion begins: V = V_y, the most at which nothing flows.
    """
    if nozzle.lag_s == 0:
        out = pieces.push_ul + pieces.jump_ul
        return NozzleFlow(out, _laid(out), np.zeros(len(out)), 0.0)
    out, held = _integrated(pieces, nozzle.lag_s, nozzle.held_ul)
    return NozzleFlow(out, _laid(out), held, nozzle.held_ul)


def _laid(out: FloatArray) -> FloatArray:
    """What goes out beyond the most that had been out: the rest only fills the needle again."""
    most = np.maximum.accumulate(np.maximum(np.cumsum(out), 0.0))
    laid: FloatArray = np.diff(most, prepend=0.0)
    return laid


def _integrated(pieces: Pieces, lag: float, yields: float) -> tuple[FloatArray, FloatArray]:
    """Outflow and held volume of each piece, µL."""
    out, held = np.zeros(len(pieces)), np.zeros(len(pieces))
    volume = yields
    columns = (pieces.duration.tolist(), pieces.push_ul.tolist(), pieces.jump_ul.tolist())
    for i, (duration, push, jump) in enumerate(zip(*columns, strict=True)):
        before = volume + jump
        volume = before + push if duration <= 0 else _after(before, push, duration, lag, yields)
        out[i] = before + push - volume
        held[i] = volume
    return out, held


def _after(volume: float, push: float, duration: float, lag: float, yields: float) -> float:
    """V after one piece: through as many of its regimes (out, still, back) as it meets."""
    rate, left = push / duration, duration
    while left > 0:
        side = _side(volume, rate, yields)
        if side == 0:
            if rate == 0:
                return volume
            edge = math.copysign(yields, rate)
            takes = (edge - volume) / rate
            if takes >= left:
                return volume + rate * left
            volume, left = edge, left - takes
            continue
        # Flow Q = (V − side V_y)/τ tends to the plunger's rate, and stops where it meets 0.
        flow = (volume - side * yields) / lag
        takes = lag * math.log1p(-flow / rate) if rate * side < 0 else math.inf
        if takes >= left:
            decay = math.exp(-left / lag)
            return side * yields + lag * (rate + (flow - rate) * decay)
        volume, left = side * yields, left - takes
    return volume


def _side(volume: float, rate: float, yields: float) -> int:
    """1 where ink flows out, -1 where it is drawn back, 0 where the yield stress holds it."""
    if volume > yields or (volume == yields and rate > 0):
        return 1
    if volume < -yields or (volume == -yields and rate < 0):
        return -1
    return 0


@dataclass(frozen=True)
class Nozzle:
    """Constants of the flow out of a needle.

    Syringe, plunger and ink give way by C µL/Pa; the needle resists. With P the pressure behind it,

    C dP/dt = Q_plunger − Q,    Q = (P − P_y) / R  for P > P_y,  else 0,

    so that V = C P, the ink that is held back, follows dV/dt = Q_plunger − (V − V_y)/τ with τ = R
    C. τ is what `printctl calibrate lag` measures. P_y = 4 τ_y L/d is what a yield stress holds in
    the needle (`firmware_profiles.yield_pressure_pa`). R is the needle's secant resistance at the
    job's flow, P(Q)/Q less P_y of a Herschel-Bulkley ink (`firmware_profiles.materials.rheology`):
    a power-law ink is taken as linear around that flow, as its measured τ is.

    Attributes
    ----------
    lag_s : float, s
        τ; 0 where the needle gives what the plunger pushes, at once.
    resistance_pa_s_ul : float, Pa·s/µL
        R; 0 where no needle is known, and then pressure isn't either.
    held_pa : float, Pa
        P_y; what drives nothing and stays behind after a stop.
    """

    lag_s: float = 0.0
    resistance_pa_s_ul: float = 0.0
    held_pa: float = 0.0

    @property
    def held_ul(self) -> float:
        """V_y = C P_y, the ink that stays compressed while nothing flows, µL."""
        if self.resistance_pa_s_ul == 0:
            return 0.0
        return self.lag_s * self.held_pa / self.resistance_pa_s_ul


def nozzle_of(ink: Ink, needle: Needle | None, lag_s: float, flow_ul_s: float) -> Nozzle:
    """Constants for an ink and a needle around a flow (µL/s); without a needle the lag alone."""
    if needle is None or flow_ul_s <= 0:
        return Nozzle(lag_s)
    held = yield_pressure_pa(ink, needle)
    return Nozzle(lag_s, (pressure_pa(ink, needle, flow_ul_s) - held) / flow_ul_s, held)


class PieceRules(NamedTuple):
    """How motion is cut into pieces."""

    longest_mm: float = 0.25  # Longest piece of way.
    gap_s: float = 1e-6  # Less between two blocks is rounding.
    per_lag: int = 8  # Pieces in a time constant: the mean stands for the flow within one.
    max_standing: int = 40  # Most pieces of a block or pause; five time constants are over by then.


PIECES: Final = PieceRules()


@dataclass(frozen=True)
class Pieces:
    """Stretches of time in each of which tip and plunger go at a constant speed.

    The speed within one block is taken as its mean: what a block speeds up and slows down takes
    v/a, hundredths of a second.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
        Of the tip.
    time : (n + 1,) float64, s
        Where each begins, and the end.
    push_ul : (n,) float64, µL
        What the plunger pushes, evenly, below 0 where it goes back.
    jump_ul : (n,) float64, µL
        What it pushes at once as the piece begins (an advance).
    block : (n,) int64
        Of the executed motion; -1 where all stands between two blocks.
    """

    start: FloatArray
    end: FloatArray
    time: FloatArray
    push_ul: FloatArray
    jump_ul: FloatArray
    block: IntArray

    def __len__(self) -> int:
        return len(self.block)

    @property
    def duration(self) -> FloatArray:
        """Of each, (n,), s."""
        return np.diff(self.time)

    @property
    def length(self) -> FloatArray:
        """Way of the tip, (n,), mm."""
        return np.linalg.norm(self.end - self.start, axis=1)


def cut(
    executed: ExecutedMotion,
    area_mm2: float,
    advance_mm: FloatArray | None = None,
    *,
    lag_s: float = 0.0,
) -> Pieces:
    """Cut a motion, so that no piece is long against the lag or the way.

    Parameters
    ----------
    executed : ExecutedMotion
        Of one head.
    area_mm2 : float, mm²
        Of the plunger, times what comes out over what is pushed.
    advance_mm : (n,) float64, mm, optional
        How far the firmware's advance holds the plunger ahead in each block; nothing without.
        It is put in as the block begins.
    """
    block, time, start, end = _with_gaps(executed)
    moved = block >= 0
    travel = executed.plunger_end - executed.plunger_start
    push = np.where(moved, travel[block], 0.0) * area_mm2
    ahead = np.zeros(len(block))
    if advance_mm is not None:
        ahead = np.where(moved, advance_mm[block], 0.0) * area_mm2
    jump = np.diff(ahead, prepend=0.0)
    length = np.linalg.norm(end - start, axis=1)
    parts = np.ceil(length / PIECES.longest_mm - 1e-9)
    if lag_s > 0:
        by_time = np.ceil(np.diff(time) * PIECES.per_lag / lag_s - 1e-9)
        parts = np.maximum(parts, np.minimum(by_time, PIECES.max_standing))
    return _divided(start, end, time, push, jump, block, np.maximum(parts, 1).astype(np.int64))


def _with_gaps(
    executed: ExecutedMotion,
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Blocks and the pauses between them: numbers (-1 a pause), times (n + 1,), places."""
    count = len(executed)
    gap = np.flatnonzero(executed.time_start[1:] - executed.time_end[:-1] > PIECES.gap_s) + 1
    block = np.insert(np.arange(count, dtype=np.int64), gap, -1)
    start = np.insert(executed.start, gap, executed.end[gap - 1], axis=0)
    end = np.insert(executed.end, gap, executed.start[gap], axis=0)
    first = np.insert(executed.time_start, gap, executed.time_end[gap - 1])
    return block, np.maximum.accumulate(np.append(first, executed.time_end[-1:])), start, end


def _divided(
    start: FloatArray,
    end: FloatArray,
    time: FloatArray,
    push: FloatArray,
    jump: FloatArray,
    block: IntArray,
    parts: IntArray,
) -> Pieces:
    of, number = split_rows(parts)
    share = 1.0 / parts[of]
    way, lasts = (end - start)[of], np.diff(time)[of]
    return Pieces(
        start[of] + (number * share)[:, None] * way,
        start[of] + ((number + 1) * share)[:, None] * way,
        np.append(time[of] + number * share * lasts, time[-1]),
        push[of] * share,
        np.where(number == 0, jump[of], 0.0),
        block[of],
    )


def median_flow(pieces: Pieces) -> float:
    """Flow at which half of what is pushed on the way is pushed, µL/s; 0 where nothing is."""
    writes = (pieces.push_ul > 0) & (pieces.length > 0) & (pieces.duration > 0)
    if not writes.any():
        return 0.0
    flow = pieces.push_ul[writes] / pieces.duration[writes]
    order = np.argsort(flow)
    pushed = np.cumsum(pieces.push_ul[writes][order])
    median = float(flow[order][np.searchsorted(pushed, pushed[-1] / 2)])
    return median if math.isfinite(median) else 0.0


@dataclass(frozen=True)
class Advance:
    """Plunger advance added by the firmware.

    With advance K the plunger stands at E + K dE/dt while a move pushes ink along a way. Known by
    Marlin as M900 K, by RepRapFirmware as M572 S, by Klipper as SET_PRESSURE_ADVANCE ADVANCE=; it
    may also stand in the firmware's own configuration (`advance_s` of the printer's profile).
    Sources: marlinfw.org/docs/gcode/M900.html, docs.duet3d.com (M572),
    www.klipper3d.org/Kinematics.html (pressure advance). The planner of `gcode.motion.planner`
    leaves it out, so that it is put in here, once.

    Modelled: the plunger is ahead by K times the E speed that the block's mean speed asks for, in
    moves that push ink and move the tip (Klipper: in x or y). Not modelled: Klipper's smoothing
    over `pressure_advance_smooth_time` (0.04 s), Marlin's restriction of changes to acceleration
    phases, limits of the plunger's speed while it catches up.

    Attributes
    ----------
    ahead_mm : (n,) float64, mm
        By how much the plunger is ahead of E in each executed block.
    most_s : float, s
        Largest K in force.
    """

    ahead_mm: FloatArray
    most_s: float


def advance_of(run: DryRun, gcode: bytes, printer: Printer) -> Advance:
    """Advance in force in each executed block of a dry run (of all heads, or of one)."""
    program, executed = run.program, run.executed
    factor = _factors(program, gcode, printer)
    if not factor.any() or not len(executed):
        return Advance(np.zeros(len(executed)), 0.0)
    ratio = _plunger_per_mm(program, across=family_of(printer).advances_across_only) * factor
    row = np.searchsorted(program.command, executed.line)
    known = (executed.line >= 0) & (row < len(program))
    way = np.linalg.norm(executed.end - executed.start, axis=1)
    lasts = np.maximum(executed.time_end - executed.time_start, 1e-9)
    ahead = np.where(known, ratio[np.minimum(row, len(program) - 1)] * way / lasts, 0.0)
    return Advance(ahead, float(factor.max()))


def _factors(program: Program, gcode: bytes, printer: Printer) -> FloatArray:
    """K at each row of the program, s."""
    lines, values = [0], [printer.advance_s]
    pattern = family_of(printer).advance
    if pattern and re.search(pattern, gcode, re.IGNORECASE):
        for number, line in enumerate(gcode.splitlines(), start=1):
            match = re.match(rb"\s*(?:N\d+\s*)?" + pattern, line, re.IGNORECASE)
            if match:
                lines.append(number)
                values.append(float(match[1]))
    at = np.searchsorted(lines, program.line, side="right") - 1
    return np.asarray(values, dtype=np.float64)[at]


def _plunger_per_mm(program: Program, *, across: bool) -> FloatArray:
    """Travel of the plunger over way of the tip, where a row pushes on its way, else 0."""
    begin = program.before[:, :3]
    way = program.target[:, :3] - begin
    length = np.linalg.norm(way, axis=1)
    counts = (program.pushed > 0) & (length > 1e-6)
    if across:
        counts &= np.linalg.norm(way[:, :2], axis=1) > 1e-6
    return np.where(counts, program.pushed / np.maximum(length, 1e-6), 0.0)
