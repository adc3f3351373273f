"""Run G-code through the planner at serial speed: duration, and moves that arrive too late."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Printer
from firmware_profiles.families.pairing import Pairing
from gcode.motion.planner import (
    add_move,
    main_share,
    next_event,
    run_until,
    set_axis,
    take_head,
)
from gcode.motion.state import (
    LOG,
    PLANNING,
    Board,
    Records,
    new_planner,
    new_ring,
)
from gcode.program.gcode import Columns, Program
from gcode.program.modal import DWELL, HOME, MOVE, SET_POSITION, SYNC, TOOL
from kernels import jit
from kernels.arrays import FloatArray, IntArray

LEAST_LOSS: Final = 0.005
"""Share of a file's time below which lost time isn't reported."""


@dataclass(frozen=True)
class PlannedProgram:
    """A program as the planner ran it.

    Attributes
    ----------
    log : (n,) of `LOG`
    duration_s : float, s
        From the first step pulse or dwell to the last.
    merged : int
        Moves below the firmware's least steps.
    starved : (n,) bool
        Rows whose move found the planner empty in mid-motion, or that it slowed down.
    """

    log: Records
    duration_s: float
    merged: int
    starved: NDArray[np.bool_]


def run_program(
    program: Program,
    printer: Printer,
    start_mm: tuple[float, float, float],
    extrudes: NDArray[np.bool_],
    times: LineTimes,
) -> PlannedProgram:
    """Run a program through the planner.

    Parameters
    ----------
    extrudes : (n,) bool
        Where the plunger may move.
    """
    planner, ring = new_planner(printer, start_mm), new_ring(printer)
    log = np.zeros(len(program) + len(ring), LOG)
    starved = np.zeros(len(program), np.bool_)
    scale = 1.0 if times.byte_s else 0.0
    block_s, corner_s, trapezoid_s = (scale * seconds for seconds in PLANNING)
    costs = _Costs(block_s, corner_s, trapezoid_s, Board().costs())
    duration = _feed(program.columns, extrudes, times, costs, planner, ring, log, starved)
    made = log[: int(planner["logged"][0])]
    return PlannedProgram(made, float(duration), int(planner["merged"][0]), starved)


@dataclass(frozen=True)
class StarvedMotion:
    """Motion that the wire is too slow for.

    Attributes
    ----------
    segments : int
        Moves that came too late: the planner ran empty, or slowed them down.
    seconds : float, s
        By which the file takes longer than with lines that come at once.
    line : int
        Of the file, of the first such move; 0 for none.
    """

    segments: int = 0
    seconds: float = 0.0
    line: int = 0


def starvation(
    program: Program,
    printer: Printer,
    start_mm: tuple[float, float, float],
    extrudes: NDArray[np.bool_],
    times: LineTimes,
    fed: PlannedProgram,
) -> StarvedMotion:
    """Compare a run with one in which lines come at once; parameters as of `run_program`."""
    if not fed.starved.any() or not times.byte_s:
        return StarvedMotion()
    at_once = times._replace(
        out_s=np.sign(times.out_s) * 1e-9,
        ok_s=times.ok_s * 0.0,
        withheld_s=times.withheld_s * 0.0,
        turnaround_s=0.0,
    )
    free = run_program(program, printer, start_mm, extrudes, at_once)
    late = fed.starved & ~free.starved
    seconds = fed.duration_s - free.duration_s
    if not late.any() or seconds < LEAST_LOSS * fed.duration_s:
        return StarvedMotion()
    return StarvedMotion(int(late.sum()), seconds, int(program.line[int(late.argmax())]))


class _Costs(NamedTuple):
    """Processor time for a block, its corner and each trapezoid, s; as of `command_time`."""

    block_s: float
    corner_s: float
    trapezoid_s: float
    board: FloatArray


@jit
def _feed(
    rows: Columns,
    extrudes: NDArray[np.bool_],
    times: LineTimes,
    costs: _Costs,
    planner: Records,
    ring: Records,
    log: Records,
    starved: NDArray[np.bool_],
) -> float:
    """Feed the planner row by row; returns the time from the first pulse or dwell to the last, s.

    ``starved`` (n,) is set where a move came too late.
    """
    now, arrival, answered, answer = 0.0, 0.0, -times.turnaround_s, 0.0
    begin, finish = np.inf, 0.0
    along = flowing = False
    for i in range(len(rows.kind)):
        kind = rows.kind[i]
        if times.out_s[i] > 0.0:
            now, arrival, answered, along = _line(times, i, now, arrival, answered, answer, along)
            answer = times.ok_s[i]
            run_until(planner, ring, log, now)
            now += times.board_s[i] / main_share(planner, ring, now, costs.board)
        run_until(planner, ring, log, now)
        alone = kind == MOVE and rows.value[i] > 0.0
        if kind == MOVE and not alone:
            if rows.tool[i] != planner[0].tool:  # of a file that doesn't name its heads
                now = _drain(planner, ring, log, now)
                take_head(planner, rows.tool[i], rows.target[i, 3])
            now = _room(planner, ring, log, now)
            if not extrudes[i]:
                set_axis(planner, 3, rows.target[i, 3])
            now, made = _move(
                planner, ring, log, rows.target[i], rows.feed[i], rows.command[i], costs, now
            )
            starved[i] = made and flowing and planner[0].starved
            flowing = flowing or made
        elif kind == SET_POSITION:
            set_axis(planner, 3, rows.target[i, 3])
        elif kind == TOOL:
            now = _drain(planner, ring, log, now)
            take_head(planner, rows.tool[i], rows.target[i, 3])
        elif kind == DWELL or alone:
            now = _drain(planner, ring, log, now)
            begin = min(begin, now)
            now += rows.value[i]
            finish = max(finish, now)
            flowing = False
        elif kind in (SYNC, HOME):
            now = _drain(planner, ring, log, now)
            flowing = False
            if kind == HOME:
                _homed(planner, rows.target[i])
    _drain(planner, ring, log, now)
    return _lasted(planner, begin, finish)


@jit
def _line(
    times: LineTimes,
    i: int,
    now: float,
    arrival: float,
    answered: float,
    answer: float,
    along: bool,
) -> tuple[float, float, float, bool]:
    """Send line i; returns when the board takes it, when it and the answer before it arrived.

    ``along`` tells whether the line before may be followed unanswered; returned for this one.
    """
    out, withheld, follows = times.out_s[i], times.withheld_s[i], along and times.follows[i]
    if follows:
        # bytes that come while the line ahead is worked on take their interrupts from it
        share = LINE_TIME.receive_s / times.byte_s if times.byte_s > 0.0 else 0.0
        now += share * min(max(now - arrival, 0.0), out - withheld)
    answered = max(answered, now + answer)
    # The board's transmitter takes two bytes at once.
    now = max(now, answered - 2 * times.byte_s)
    if follows and withheld > 0.0:
        arrival = max(arrival + out - withheld, answered + times.turnaround_s) + withheld
    elif follows:
        arrival += out
        along = False
    else:
        arrival = answered + times.turnaround_s + out
        along = True
    return max(now, arrival), arrival, answered, along


@jit
def _move(
    planner: Records,
    ring: Records,
    log: Records,
    target: FloatArray,
    feed: float,
    command: int,
    costs: _Costs,
    now: float,
) -> tuple[float, bool]:
    """Plan a move that there is room for; returns when that is done, and if it made a block."""
    share = main_share(planner, ring, now, costs.board)
    waits = planner[0].count > (1 if planner[0].running else 0)
    planned = now + (costs.block_s + (costs.corner_s if waits else 0.0)) / share
    run_until(planner, ring, log, planned)
    if not add_move(planner, ring, target, feed, command, planned):
        return now, False
    planned += planner[0].trapezoids * costs.trapezoid_s / share
    return planned, True


@jit
def _room(planner: Records, ring: Records, log: Records, now: float) -> float:
    """Wait for a free place in the ring; returns when there is one."""
    while planner[0].count >= len(ring) - 1:
        now = max(now, next_event(planner))
        run_until(planner, ring, log, now)
    return now


@jit
def _homed(planner: Records, target: FloatArray) -> None:
    for axis in range(3):
        set_axis(planner, axis, target[axis])


@jit
def _lasted(planner: Records, begin: float, finish: float) -> float:
    """Seconds from the first pulse or dwell to the last, dwells included."""
    if planner[0].logged > 0:
        begin = min(begin, planner[0].first_pulse)
        finish = max(finish, planner[0].run_end)
    return max(finish - begin, 0.0)


@jit
def _drain(planner: Records, ring: Records, log: Records, now: float) -> float:
    """Let the motors finish; returns when they stand."""
    while planner[0].count > 0:
        now = max(now, next_event(planner))
        run_until(planner, ring, log, now)
    return now


# A line leaves as the link sends it, with number and checksum, once the host has read the last
# `ok`; so the time between two lines is wire out + board + wire back + the host's turnaround. With
# two lines in flight the link's own rule (`firmware_profiles.families.pairing`) tells which line
# follows before that.
#
# The board's times are those of Marlin bugfix-2.1.x on an ATmega2560 at 16 MHz, run in an AVR
# simulator at 0.15 of real time, so that the host's own time is below 0.1 ms of the board's: 156
# lines of 13 sorts without motion, and 600 moves of 0.05 to 0.2 mm, at both bauds, each from its
# last byte in to its first byte back. They reproduce the medians within 0.05 ms.
#
# Modelled: bytes both ways at the rate that the board's divider gives, ADVANCED_OK's longer
# answers, pairs of lines in flight, the processor's time by bytes, blocks and trapezoids. Not
# modelled: a report that the board makes on its own, lines sent again, a host that stalls.
_BITS_PER_BYTE: Final = 10


class LineTime(NamedTuple):
    """Time of an 8-bit board for a line, measured as described above."""

    # Of the boards that make their baud with a divider of 8 bits' grain.
    clock_hz: int = 16_000_000
    fine_baud: int = 57_600  # Above it the divider counts eighths of the clock (U2X).
    line_s: float = 0.06e-3
    byte_s: float = 15.5e-6
    move_s: float = 0.34e-3
    # A received byte's interrupt, some 130 cycles; felt where the processor works meanwhile.
    receive_s: float = 8e-6


LINE_TIME: Final = LineTime()


class LineTimes(NamedTuple):
    """Times of each row of a program, (n,) float64, s; 0 for rows that come with the one before.

    Attributes
    ----------
    out_s, ok_s, board_s : (n,) float64, s
        Of the bytes to the board, of the answer's bytes, and of the processor without the planner.
    follows : (n,) bool
        Rows whose line may leave before the one ahead of it is answered.
    withheld_s : (n,) float64, s
        Of a line that follows, the end that leaves once the one ahead is answered; 0 where both
        leave whole, and the next with the answer to both.
    byte_s : float, s
        0 where the controller has the whole file.
    turnaround_s : float, s
        From an answer's last byte to the next line's first.
    """

    out_s: FloatArray
    ok_s: FloatArray
    board_s: FloatArray
    follows: NDArray[np.bool_]
    withheld_s: FloatArray
    byte_s: float
    turnaround_s: float


def byte_seconds(printer: Printer) -> float:
    """Return a byte's time on the wire, s, as the board's divider of its clock gives it."""
    baud = float(printer.baud)
    if printer.max_step_rate_hz is None and printer.baud > LINE_TIME.fine_baud:  # an 8-bit board
        baud = (
            LINE_TIME.clock_hz / 8 / max((LINE_TIME.clock_hz // 4 // printer.baud - 1) // 2 + 1, 1)
        )
    return _BITS_PER_BYTE / baud


def line_times(program: Program, gcode: bytes, printer: Printer) -> LineTimes:
    """Return the times of a program's lines.

    Parameters
    ----------
    gcode : bytes
        What it was read from, each line as it is sent.
    """
    sums = checksums(program, gcode)
    sent, nothing = sent_bytes(program, sums), np.zeros(len(program))
    if not printer.streamed:  # the controller has the whole file
        return LineTimes(sent * 1e-9, nothing, nothing, nothing > 0, nothing, 0.0, 0.0)
    byte_s, moves = byte_seconds(printer), program.kind == MOVE
    answer = np.full(len(program), 3.0)
    if printer.advanced_ok:  # ok N123 P15 B3
        answer += 9 + np.floor(np.log10(program.command + 1)) + 1
    follows, withheld = nothing > 0, nothing
    if printer.lines_in_flight == 2:
        follows, withheld = _followers(program, gcode, sent, sums, printer)
    return LineTimes(
        out_s=sent * byte_s,
        ok_s=answer * byte_s,
        board_s=np.where(
            sent > 0, LINE_TIME.line_s + LINE_TIME.byte_s * sent + LINE_TIME.move_s * moves, 0.0
        ),
        follows=follows,
        withheld_s=withheld * byte_s,
        byte_s=byte_s,
        turnaround_s=printer.host_turnaround_s,
    )


def _followers(
    program: Program, gcode: bytes, sent: FloatArray, sums: NDArray[np.int64], printer: Printer
) -> tuple[NDArray[np.bool_], FloatArray]:
    """Return which lines may follow the one ahead unanswered, and how many bytes they keep back.

    The rule is the link's own, applied to each two lines: both (n,).
    """
    pairing = Pairing(printer.receive_buffer_bytes, printer.withholds)
    follows, withheld = np.zeros(len(program), np.bool_), np.zeros(len(program))
    lines = gcode.split(b"\n")
    rows = np.flatnonzero(program.length > 0)
    texts = [lines[program.line[i] - 1].lstrip()[: program.length[i]] for i in rows]
    for (i, first), (k, second) in pairwise(zip(rows, texts, strict=True)):
        follows[k] = pairing.allows(first, second, int(sent[i] + sent[k]))
        withheld[k] = pairing.withheld(b"*%d\n" % sums[k])
    return follows, withheld


def checksums(program: Program, gcode: bytes) -> IntArray:
    """Return the checksum of each row's line as sent, (n,): the XOR of its bytes and its number's.

    ``gcode`` has its lines as they are sent, without blanks before the command.
    """
    text = np.frombuffer(gcode, np.uint8)
    upto = np.append(0, np.bitwise_xor.accumulate(text)).astype(np.int64)
    begin = np.append(0, np.flatnonzero(text == ord("\n")) + 1)[program.line - 1]
    end = np.minimum(begin + program.length, len(text))
    sums = upto[end] ^ upto[begin] ^ ord("N") ^ ord(" ")
    number = program.command + 1
    while number.any():
        sums ^= np.where(number > 0, ord("0") + number % 10, 0)
        number = number // 10
    return np.where(program.length > 0, sums, 0)


def sent_bytes(program: Program, sums: NDArray[np.int64]) -> FloatArray:
    """Return the bytes of each row as sent, number, checksum and line end with it; (n,)."""
    digits = np.floor(np.log10(program.command + 1)).astype(np.int64) + 1
    check = 1 + (sums > 9).astype(np.int64) + (sums > 99)
    # N, digits, a blank, the command, *, checksum, line end
    return np.where(program.length > 0, program.length + digits + check + 4, 0).astype(np.float64)
