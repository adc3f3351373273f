"""Fast path of the simulated Marlin for one numbered G0 or G1.

It does what the general path (`sim.devices.board.printer`) does, for the one case that makes up a
print: the board waits for a line, the line is whole, numbered as expected, its checksum is good, it
is a straight move and the planner has a place, now or when the next block ends. Anything else is
left untouched to the general path.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kernels import jit
from sim.devices.board.controller import Controller
from sim.devices.families.marlin.report_commands import ok_words
from sim.gcode.motion.planner import add_move, command_time, next_event, run_until
from sim.gcode.motion.state import Record, Records
from sim.gcode.program.modal import has_word, interpret, number_at, speed, split_words

NOT_TAKEN: Final = -1.0
_N, _STAR, _G, _SEMICOLON, _EOL = ord("N"), ord("*"), ord("G"), ord(";"), 10
_E_LETTER = 4


@jit
def is_sound_move(line: bytes, expected: int, longest: int, row: Record) -> bool:
    r"""Whether a line is whole, numbered as expected, sound by its checksum, and G0 or G1.

    Parameters
    ----------
    line, expected, longest
        As in `take_numbered_move`.
    row : record of `sim.gcode.program.modal.WORDS`
        Gets the line's words where it comes to that.
    """
    size = len(line) - 1
    if size < 6 or size > longest or line[0] != _N or line[size] != _EOL:
        return False
    star = size - 1
    while star > 0 and line[star] != _STAR:
        star -= 1
    given, after = number_at(line, star + 1, size)
    if star == 0 or after != size:
        return False
    xor = 0
    for i in range(star):
        if line[i] == _SEMICOLON or line[i] == _EOL:
            return False
        xor ^= line[i]
    split_words(line, 0, size, row)
    if int(given) != xor or row.numbered != expected:
        return False
    return row.letter == _G and 0 <= row.number <= 1


@jit
def take_numbered_move(
    line: bytes,
    expected: int,
    longest: int,
    cold: bool,
    modal: Records,
    words: Records,
    planner: Records,
    ring: Records,
    log: Records,
    now: float,
    alarm: float,
    job_line: int,
    costs: NDArray[np.float64],
) -> float:
    r"""Take a line if it is the plain next move.

    Parameters
    ----------
    line : bytes
        With its ``\n``.
    expected : int
        The next line number.
    longest : int
        Bytes that the firmware keeps of a line.
    cold : bool
        Whether the plunger may not move.
    modal, words, planner, ring, log : records
        State of the firmware.
    now : float, s
        When the line's last byte arrived.
    alarm : float, s
        Nothing else may happen before this time; a wait beyond it isn't for this road.
    job_line : int
        Kept with the block.
    costs : (5,) float64
        Of the processor, see `sim.gcode.motion.planner.command_time`.

    Returns
    -------
    float
        When the move was taken, s; `NOT_TAKEN` where nothing was done.
    """
    row = words[0]
    if planner[0].logged + 2 * len(ring) > len(log):
        return NOT_TAKEN
    if not is_sound_move(line, expected, longest, row) or (cold and has_word(row, _E_LETTER)):
        return NOT_TAKEN
    run_until(planner, ring, log, now)
    now += command_time(planner, ring, now, costs)
    run_until(planner, ring, log, now)
    if planner[0].count >= len(ring) - 1:
        free = max(now, next_event(planner))
        if free > alarm:
            return NOT_TAKEN
        now = free
        run_until(planner, ring, log, now)
    if now > alarm:
        return NOT_TAKEN
    interpret(modal[0], row)
    add_move(planner, ring, modal[0].position, speed(modal[0]), job_line, now)
    return now


# Take consecutive plain moves into the simulated Marlin at once (fast path).


def take_plain_moves(board: Controller, data: bytes, alarm: Callable[[], float]) -> bytes:
    """Take the plain moves at the front of ``data``; return what is left.

    Parameters
    ----------
    alarm : callable
        When the main loop next has something to do of its own, s.
    """
    wire, machine = board.wire, board.machine
    if machine.dead or machine.settings.has_least_feeds or machine.motion.slope:
        return data
    if not board.work.idle or len(data) > wire.capacity:
        return data
    if not wire.quiet or not board.reader.empty or board.plan.counts_bytes:
        return data
    arrived = wire.occupied_until(machine.now)
    while data:
        end = data.find(b"\n") + 1
        line = data if end == len(data) else data[:end]
        arrived += end * wire.byte_s
        if end == 0 or not _take(board, line, max(arrived, machine.now), alarm):
            return data
        data = data[end:]
    return data


def _take(board: Controller, line: bytes, arrived: float, alarm: Callable[[], float]) -> bool:
    """Take one line, whose last byte arrived at ``arrived``, s; whether it was a plain move."""
    machine = board.machine
    motion, printer = machine.motion, machine.printer
    expected = board.lines.last_number + 1
    if board.plan.has_line(expected) or arrived < motion.closed_until:
        return False
    taken = take_numbered_move(
        line,
        expected,
        printer.max_line_bytes - 1,
        machine.too_cold or machine.dry,
        motion.modal,
        board.words,
        motion.planner,
        motion.ring,
        motion.log,
        arrived,
        min(alarm(), arrived + (machine.reports.keepalive_s or math.inf)),
        expected - 1 if board.job is None else board.job.find(line),
        motion.costs,
    )
    if taken == NOT_TAKEN:
        return False
    if board.job is not None:
        board.job.take(line)
    machine.now = machine.idle_since = taken
    board.lines.last_number = expected
    if printer.advanced_ok:
        board.work.line = line
    board.say_ok(ok_words(board))
    return True
