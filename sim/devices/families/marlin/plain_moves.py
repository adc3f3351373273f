"""Take consecutive plain moves into the simulated Marlin at once (fast path)."""

from __future__ import annotations

import math
from collections.abc import Callable

from sim.devices.board.controller import Controller
from sim.devices.families.marlin.fast_path import NOT_TAKEN, take_numbered_move
from sim.devices.families.marlin.report_commands import ok_words


def take_plain_moves(board: Controller, data: bytes, alarm: Callable[[], float]) -> bytes:
    """Take the plain moves at the front of ``data``; return what is left.

    Parameters
    ----------
    board : Controller
    data : bytes
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
