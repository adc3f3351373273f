"""Plan the moves of a few job lines; count those surely made, predict how motors run on.

Pure Python, for the link process: the compiled planner (`gcode.motion.planner`) is the dry
run's.

A firmware says ok when it has put a move into its planner. So the last moves taken, as many as
planner and command queue hold, may still be ahead; once it has answered M400, none is.

Run-on: a halted Marlin waits 0.6 s of its processor's own time for its words to get out, and each
step event meanwhile takes some of that time (`printctl.machine.control.board.halting`). So with
N(t) events made until t the motors, at t0 when it halts, stop at t1 with
(t1 - t0) - c (N(t1) - N(t0)) = wait.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Final, NamedTuple

from firmware_profiles import Axes, Printer
from gcode.reading import GcodeLine, is_motion, read_sent
from printctl.machine.families import link_facts
from printctl.machine.job.coordinates import Modal, declared_axes

_AXES: Final = "XYZE"
FAR_MM: Final = 1000.0
"""Length of a move on an axis whose place is unknown before: as long as any."""
ARC_PIECE_MM: Final = 1.0
"""Length of an arc's pieces, each a block of the planner (Marlin's MAX_ARC_SEGMENT_MM)."""
ARC_PIECES_PER_TURN: Final = 72
"""At the least, so that small arcs have shorter ones (MIN_CIRCLE_SEGMENTS)."""
_STRAIGHT: Final = 0.999999
"""Cosine of an angle from which on a corner counts as none, or as a way straight back."""
STEP_S: Final = 47.5e-6
"""Of the processor's time for each step event of a Marlin on an 8-bit board, s (measured)."""
CLOCK_S: Final = 0.05
"""By which an answer may be late: board, wire and host, s."""
SLACK_S: Final = 0.02
"""By which the motors' place in the moves' time is uncertain, s."""
MAX_STEPS_PER_S: Final = 11_000.0
"""Step events/s beyond which load grows no more: one interrupt makes two."""


def moves_ahead(printer: Printer) -> float:
    """Return the most moves that a printer may have taken and not made.

    Infinite for a firmware that plans by time: short moves are ahead by the hundred.
    """
    if link_facts(printer).plans_by_time:
        return math.inf
    return printer.planner_blocks + printer.command_queue


def surely_moved(lines: Sequence[bytes], taken: int, queued: float, least: int = 0) -> int:
    """Return how many lines' motion had ended when ``taken`` were taken.

    ``queued``: most moves that may be ahead, infinite for unknown; ``least`` lines are known to
    have been made.
    """
    if math.isinf(queued):
        return min(least, taken)
    left = queued
    for index in range(taken - 1, least - 1, -1):
        if is_motion(lines[index]):
            if left == 0:
                return index + 1
            left -= 1
    return min(least, taken)


@dataclass(frozen=True)
class PlannedMove:
    """One straight move, or piece of an arc."""

    line: int  # of the job, from 0
    length_mm: float  # path of the tip, or of the plunger where that moves alone
    events: float  # steps of the motor that makes the most of them
    top_mm_s: float  # along the path, by feed rate, motors' limits, and an arc's radius
    acceleration_mm_s2: float  # along the path
    way: tuple[float, ...]  # unit vector of its direction, X Y Z E


def planned_moves(
    lines: Sequence[bytes], first: int, end: int, at: Modal, printer: Printer
) -> list[PlannedMove]:
    """Return the moves of ``lines[first:end]``, all absolute; ``at`` before ``first``."""
    place = {axis.upper(): mm for axis, mm in at.place().items()}
    feed, moves = at.f, list[PlannedMove]()
    for index in range(first, end):
        line = read_sent(lines[index])
        given = {axis: mm for axis in _AXES if (mm := line.number(axis)) is not None}
        feed = line.number("F") or feed
        if is_motion(lines[index]):
            way = [given[a] - place.get(a, given[a] - FAR_MM) if a in given else 0.0 for a in _AXES]
            speed = printer.max_speed_mm_s.x if feed is None else feed / 60.0
            moves += [
                _move(index, piece, top, printer)
                for piece, top in _pieces(line, way, speed, printer)
            ]
        if is_motion(lines[index]) or line.code == "G92":
            place |= given
        else:
            place |= declared_axes(lines[index])
    return moves


def planned_s(lines: Sequence[bytes], first: int, end: int, at: Modal, printer: Printer) -> float:
    """Return how long the moves and dwells of ``lines[first:end]`` take, s, at standstill before.

    ``at``: before ``first``. A move from an unknown place is as long as any.
    """
    moves = planned_moves(lines, first, end, at, printer)
    starts = motion_of(moves, printer).starts if moves else [0.0]
    dwells = sum(dwell_s(one) for one in lines[first:end] if one.startswith(b"G4 "))
    return starts[-1] - starts[0] + dwells


def dwell_s(line: bytes) -> float:
    """Return how long a dwell (G4) lasts, s."""
    words = read_sent(line)
    return (words.number("S") or 0.0) + (words.number("P") or 0.0) / 1000.0


def _pieces(
    line: GcodeLine, way: Sequence[float], feed_mm_s: float, printer: Printer
) -> Iterator[tuple[Sequence[float], float]]:
    """Yield the straight pieces of a line, mm in X Y Z E, with their greatest speed, mm/s."""
    if line.code not in ("G2", "G3"):
        if any(way):
            yield way, feed_mm_s
        return
    i, j = _centre(line, way)
    radius, begin = math.hypot(i, j), math.atan2(-j, -i)
    turn = math.atan2(way[1] - j, way[0] - i) - begin
    turn = turn % math.tau or math.tau
    turn -= math.tau if line.code == "G2" else 0.0
    least = math.ceil(ARC_PIECES_PER_TURN * abs(turn) / math.tau)
    count = max(math.ceil(radius * abs(turn) / ARC_PIECE_MM), least, 1)
    top = min(feed_mm_s, math.sqrt(printer.acceleration_mm_s2 * radius))
    angles = [begin + turn * k / count for k in range(count + 1)]
    for a, b in pairwise(angles):
        x, y = radius * (math.cos(b) - math.cos(a)), radius * (math.sin(b) - math.sin(a))
        yield (x, y, way[2] / count, way[3] / count), top


def _centre(line: GcodeLine, way: Sequence[float]) -> tuple[float, float]:
    """Return an arc's centre as seen from its begin, mm."""
    radius = line.number("R")
    if radius is None:
        return line.number("I") or 0.0, line.number("J") or 0.0
    x, y = way[0], way[1]
    chord_sq = max(x * x + y * y, 1e-12)
    height = math.sqrt(max(radius * radius / chord_sq - 0.25, 0.0))
    side = height if (line.code == "G3") == (radius > 0) else -height
    return x / 2 - side * y, y / 2 + side * x


def _move(index: int, way: Sequence[float], feed_mm_s: float, printer: Printer) -> PlannedMove:
    length = max(math.hypot(*way[:3]) or abs(way[3]), 1e-6)
    shares = [abs(mm) / length for mm in way]
    steps = [count * abs(mm) for (_, count), mm in zip(printer.steps_per_mm, way, strict=True)]
    size = math.hypot(*way) or 1.0

    def slowest(along: float, motors: Axes) -> float:
        limits = zip(motors, shares, strict=True)
        return min([along, *(limit / share for (_, limit), share in limits if share > 0.0)])

    return PlannedMove(
        line=index,
        length_mm=length,
        events=max(steps),
        top_mm_s=slowest(feed_mm_s, printer.max_speed_mm_s),
        acceleration_mm_s2=slowest(printer.acceleration_mm_s2, printer.max_acceleration_mm_s2),
        way=tuple(mm / size for mm in way),
    )


def corner_mm_s(before: PlannedMove, after: PlannedMove, printer: Printer) -> float:
    """Return the speed at the corner of two moves, mm/s: Marlin's junction deviation.

    v² = a d s / (1 - s) with the deviation d and s = sin(θ/2) (Sonny Jeon's centripetal model, as
    in Grbl and Marlin, and `gcode.motion.block.junction_sq`); small segments' rule left out.
    """
    top = min(before.top_mm_s, after.top_mm_s)
    cosine = -sum(a * b for a, b in zip(before.way, after.way, strict=True))
    if cosine > _STRAIGHT:
        return 0.0
    half_sine = math.sqrt(0.5 * (1.0 - max(cosine, -_STRAIGHT)))
    acceleration = min(before.acceleration_mm_s2, after.acceleration_mm_s2)
    speed_sq = acceleration * printer.junction_deviation_mm * half_sine / (1.0 - half_sine)
    return min(top, math.sqrt(speed_sq))


class MotorRunOn(NamedTuple):
    """How long motors run on, s, and how far the tip, mm."""

    seconds: float
    path_mm: float


@dataclass(frozen=True)
class MoveTimeline:
    """Motion of moves one behind the other, as straight pieces between knots."""

    time_s: list[float]  # of each knot
    wait_s: list[float]  # the processor's own time passed at each: less ``STEP_S`` an event
    path_mm: list[float]
    starts: list[float]  # when each move begins, and when the last one ends, s
    held: int  # moves that a planner holds, the running one too

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


def motion_of(moves: Sequence[PlannedMove], printer: Printer) -> MoveTimeline:
    """Plan moves one behind the other, from a standstill to a standstill.

    Corners as `corner_mm_s`, each trapezoid as a planner with lookahead makes it.
    """
    entries = [0.0, *(corner_mm_s(a, b, printer) for a, b in pairwise(moves)), 0.0]
    for index in range(len(moves) - 1, -1, -1):
        entries[index] = min(entries[index], _reachable(entries[index + 1], moves[index]))
    for index, move in enumerate(moves):
        entries[index + 1] = min(entries[index + 1], _reachable(entries[index], move))
    pieces, counts = list[tuple[float, float, float]](), [0]
    for index, move in enumerate(moves):
        pieces += _trapezoid(move, entries[index], entries[index + 1])
        counts.append(len(pieces))
    time = list(accumulate((s for s, _, _ in pieces), initial=0.0))
    own_s = (s - STEP_S * min(n, MAX_STEPS_PER_S * s) for s, n, _ in pieces)
    wait = list(accumulate(own_s, initial=0.0))
    path = list(accumulate((mm for *_, mm in pieces), initial=0.0))
    starts = [time[count] for count in counts]
    return MoveTimeline(time, wait, path, starts, printer.planner_blocks - 1)


def _reachable(mm_s: float, move: PlannedMove) -> float:
    return math.sqrt(mm_s * mm_s + 2.0 * move.acceleration_mm_s2 * move.length_mm)


def _trapezoid(move: PlannedMove, enters: float, leaves: float) -> list[tuple[float, float, float]]:
    """Return the phases of a move: seconds, events and mm of each."""
    acceleration, per_mm = move.acceleration_mm_s2, move.events / move.length_mm
    top_sq = 0.5 * (enters * enters + leaves * leaves) + acceleration * move.length_mm
    top = max(min(move.top_mm_s, math.sqrt(top_sq)), enters, leaves)
    up, down = (
        (top * top - enters * enters) / 2 / acceleration,
        (top * top - leaves * leaves) / 2 / acceleration,
    )
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


class Answers(NamedTuple):
    """Lines taken at the answer before the last and when that came, s; the same of the last."""

    before: int
    before_s: float
    last: int
    last_s: float


def longest_run_on(
    moves: Sequence[PlannedMove], sure: int, answers: Answers, now: float, printer: Printer
) -> MotorRunOn:
    """Return the farthest that motors may run on after a halt at ``now``, s.

    While the planner is full it answers a line when a move ends. So where the last answers came
    as far apart as the moves' model says, the motors' place is known; else they may be anywhere.
    ``moves`` may be under way, or come before those; ``sure`` lines of the job were certainly made.
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
    return link_facts(printer).run_on_s / (1.0 - STEP_S * min(events, MAX_STEPS_PER_S))


def _place_s(
    motion: MoveTimeline, moves: Sequence[PlannedMove], answers: Answers, now: float
) -> float | None:
    """Return when in the moves' time the motors are at ``now``, s; None for unknown."""
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
