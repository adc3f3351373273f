"""Predict time and path of motors running on after a Marlin halt, from moves in the planner.

Its processor waits 0.6 s of its own time for its words to get out, and each step event meanwhile
takes some of that time (`printctl.machine.control.halting`). So with N(t) events made until t the
motors, at t0 when it halts, stop at t1 with (t1 - t0) - c (N(t1) - N(t0)) = wait.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Final, NamedTuple

from firmware_profiles import Printer
from printctl.machine.families import link_facts
from printctl.machine.job.planned_moves import PlannedMove, corner_mm_s

STEP_S: Final = 47.5e-6
"""Of the processor's time for each step event of a Marlin on an 8-bit board, s."""
CLOCK_S: Final = 0.05
"""By which an answer may be late: board, wire and host, s."""
SLACK_S: Final = 0.02
"""By which the motors' place in the moves' time is uncertain, s."""
MOST_STEPS: Final = 11_000.0
"""Step events/s beyond which load grows no more: one interrupt makes two."""


class MotorRunOn(NamedTuple):
    """How long motors run on, s, and how far the tip, mm."""

    seconds: float
    path_mm: float


@dataclass(frozen=True)
class MoveTimeline:
    """Motion of moves one behind the other, as straight pieces between knots.

    Attributes
    ----------
    time_s : list of float, s
        Of each knot.
    wait_s : list of float, s
        Of the processor's own time that has passed at each: time less ``STEP_S`` an event.
    path_mm : list of float, mm
    starts : list of float, s
        When each move begins, and when the last one ends.
    held : int
        Moves that a planner holds, the running one too.
    """

    time_s: list[float]
    wait_s: list[float]
    path_mm: list[float]
    starts: list[float]
    held: int

    def ends_after(self, begin_s: float, wait_s: float) -> MotorRunOn:
        """Return how far motors run on from ``begin_s``."""
        running = max(bisect_right(self.starts, begin_s) - 1, 0)
        empty_s = self.starts[min(running + self.held, len(self.starts) - 1)]
        begin = _between(self.time_s, self.wait_s, begin_s)
        end_s = min(_between(self.wait_s, self.time_s, begin + wait_s), max(empty_s, begin_s))
        path = _between(self.time_s, self.path_mm, end_s)
        return MotorRunOn(end_s - begin_s, path - _between(self.time_s, self.path_mm, begin_s))

    def longest(self, begin_s: float, end_s: float, wait_s: float) -> MotorRunOn:
        """Return the longest of `ends_after` for a halt between two moments.

        Between knots, and the moments from which the motors stop at a knot, the time is linear.
        """
        before = [_between(self.wait_s, self.time_s, wait - wait_s) for wait in self.wait_s]
        inside = [t for t in (*self.time_s, *before) if begin_s <= t <= end_s]
        return max(self.ends_after(moment, wait_s) for moment in (begin_s, *inside, end_s))


@dataclass(frozen=True)
class Answers:
    """When a printer has taken the last lines of a job.

    Attributes
    ----------
    before, before_s : int, float
        Lines that were taken at the answer before the last, and when that came, s.
    last, last_s : int, float
        The same of the last answer.
    """

    before: int
    before_s: float
    last: int
    last_s: float


def longest_run_on(
    moves: Sequence[PlannedMove], sure: int, answers: Answers, now: float, printer: Printer
) -> MotorRunOn:
    """Return the farthest that motors may run on after a halt.

    While the planner is full it answers a line when a move ends. So where the last answers came
    as far apart as the moves' model says, the motors' place is known; else they may be anywhere.

    Parameters
    ----------
    moves : sequence of PlannedMove
        Those that may be under way, and some before them.
    sure : int
        Lines of the job that were certainly made.
    answers : Answers
    now : float, s
        When the firmware halted.
    printer : Printer
    """
    wait_s = link_facts(printer).run_on_s
    motion = motion_of(moves, printer)
    place_s = _place_s(motion, moves, answers, now)
    if place_s is not None:
        return motion.longest(place_s - SLACK_S, place_s + SLACK_S, wait_s)
    first = sum(move.line < sure for move in moves)
    return motion.longest(motion.starts[first], motion.starts[-1], wait_s)


def unknown_run_on(printer: Printer) -> float:
    """Return for how long motors run on at the machine's greatest speed, s."""
    pairs = zip(printer.max_speed_mm_s, printer.steps_per_mm, strict=True)
    events = max(speed * steps for (_, speed), (_, steps) in pairs)
    return link_facts(printer).run_on_s / (1.0 - STEP_S * min(events, MOST_STEPS))


def _place_s(
    motion: MoveTimeline, moves: Sequence[PlannedMove], answers: Answers, now: float
) -> float | None:
    """Return when in the moves' time the motors are at ``now``, s; None where nobody knows."""
    last, before = (
        sum(move.line < taken for move in moves) - motion.held
        for taken in (answers.last, answers.before)
    )
    if before < 0:
        return None
    apart_s = motion.starts[last] - motion.starts[before]
    heard_s, place_s = answers.last_s - answers.before_s, motion.starts[last] + now - answers.last_s
    agrees = apart_s > CLOCK_S and abs(heard_s - apart_s) < CLOCK_S + 0.1 * apart_s
    latest_s = motion.starts[max(len(moves) - motion.held, last)] + CLOCK_S
    return place_s if agrees and place_s < latest_s else None


def motion_of(moves: Sequence[PlannedMove], printer: Printer) -> MoveTimeline:
    """Plan moves one behind the other, from a standstill to a standstill.

    Corners as `corner_mm_s`, each trapezoid as a planner with lookahead makes it.
    """
    corners = [corner_mm_s(a, b, printer) for a, b in pairwise(moves)]
    entries = [0.0, *corners, 0.0]
    for index in range(len(moves) - 1, -1, -1):
        entries[index] = min(entries[index], _reachable(entries[index + 1], moves[index]))
    for index, move in enumerate(moves):
        entries[index + 1] = min(entries[index + 1], _reachable(entries[index], move))
    pieces: list[tuple[float, float, float]] = []
    counts = [0]
    for index, move in enumerate(moves):
        pieces += _trapezoid(move, entries[index], entries[index + 1])
        counts.append(len(pieces))
    time = list(accumulate((s for s, _, _ in pieces), initial=0.0))
    wait = accumulate((s - STEP_S * min(n, MOST_STEPS * s) for s, n, _ in pieces), initial=0.0)
    path = list(accumulate((mm for *_, mm in pieces), initial=0.0))
    starts = [time[count] for count in counts]
    return MoveTimeline(time, list(wait), path, starts, printer.planner_blocks - 1)


def _reachable(mm_s: float, move: PlannedMove) -> float:
    return math.sqrt(mm_s * mm_s + 2.0 * move.acceleration_mm_s2 * move.length_mm)


def _trapezoid(move: PlannedMove, enters: float, leaves: float) -> list[tuple[float, float, float]]:
    """Return the phases of a move: seconds, events and mm of each."""
    acceleration, per_mm = move.acceleration_mm_s2, move.events / move.length_mm
    top_sq = 0.5 * (enters * enters + leaves * leaves) + acceleration * move.length_mm
    top = max(min(move.top_mm_s, math.sqrt(top_sq)), enters, leaves)
    up, down = (top * top - enters * enters) / 2, (top * top - leaves * leaves) / 2
    up, down = up / acceleration, down / acceleration
    flat = max(move.length_mm - up - down, 0.0)
    phases = [((top - enters) / acceleration, up), (flat / top, flat)]
    phases.append(((top - leaves) / acceleration, down))
    return [(seconds, mm * per_mm, mm) for seconds, mm in phases if seconds > 0.0]


def _between(xs: Sequence[float], ys: Sequence[float], x: float) -> float:
    """Return y at x of a line through knots with rising xs; beyond its ends with a slope of 1."""
    if x >= xs[-1]:
        return ys[-1] + x - xs[-1]
    if x <= xs[0]:
        return ys[0] + x - xs[0]
    after = bisect_left(xs, x)
    share = (x - xs[after - 1]) / (xs[after] - xs[after - 1])
    return ys[after - 1] + share * (ys[after] - ys[after - 1])
