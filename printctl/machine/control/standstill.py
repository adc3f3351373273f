"""Detect standstills of the ink: time that the planned moves in flight don't explain.

A firmware answers a line when its planner has room for it: with a full planner, when a move ends.
So an answer that is later than the moves' plan says is suspicious. What the next answers show
decides: a board whose motors stood goes on at its old pace; one that was merely not heard has made
moves meanwhile and takes as many lines at once.

A firmware that plans by time (Klipper) lets an answer wait once it holds moves of a certain time:
how long, the first answers that wait since the machine stood tell. So the end of its moves is
known, and it stood from there to a later answer.

Not modelled: standstills of a planner that is never full for as long as it isn't empty.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from firmware_profiles import Printer
from printctl.machine.job.completed_moves import moves_ahead
from printctl.machine.job.coordinates import modal_state
from printctl.machine.job.motor_run_on import motion_of
from printctl.machine.job.planned_moves import FAR_MM, planned_moves
from sim.gcode.reading import is_motion, read_sent

SHORTEST_S: Final = 1.0
MODEL_ERROR: Final = 0.05
"""Share by which moves may take longer than planned; the dry run is within 3 %."""
_LATE_S: Final = 0.3
_TURNAROUND_S: Final = 0.05
"""An answer within this waited for no move."""
_MEASURED: Final = 3
"""Answers since a rest by which is measured how much such a firmware (Klipper) holds ahead."""
_UNMEASURED_S: Final = 2.25
"""As much where a move came from a place that nobody has named."""
_BEGIN_S: Final = 0.25
"""Time for which such a firmware lets its first moves wait (Klipper: toolhead.py)."""
_UNBOUNDED: Final = re.compile(
    rb"(?!SET_)[A-Z]{2}|T|G(28|29|30|32)\b|M(0|1|6|109|116|190|191|226|291|303|600)\b"
)
"""Lines that nobody knows the time of: homing, waits for heat or for a person, changes of tool."""


@dataclass(frozen=True)
class Standstill:
    """Time in which the ink stood still.

    Attributes
    ----------
    line, last : int
        Job lines made before it: at least and at most. The place is between their ends.
    seconds : float, s
    """

    line: int
    last: int
    seconds: float


@dataclass(frozen=True)
class _Late:
    """A late answer that is still to be judged.

    Attributes
    ----------
    line : int
        Job lines taken before it.
    reached : int
        Those, and what was in flight where it may have arrived before the answers failed.
    before_s, came_s : float, s
        When those and it were answered.
    was_full : bool
    """

    line: int
    reached: int
    before_s: float
    came_s: float
    was_full: bool


class StandstillWatch:
    """Finds standstills from the times at which a printer took its lines.

    Parameters
    ----------
    printer : Printer
    """

    def __init__(self, printer: Printer) -> None:
        self._printer = printer
        ahead = moves_ahead(printer)
        self._by_time = math.isinf(ahead)
        self._held = printer.planner_blocks - 1
        most = self._held if self._by_time else int(ahead)
        self._shifts = range(max(self._held - 1, 0), most + 1)
        self._taken: deque[tuple[int, float]] = deque(maxlen=2 * self._shifts[-1] + 8)
        self._rested: int | None = None
        self._rested_s = -math.inf
        self._resent = 0
        self._ends_s, self._held_s, self._waited = math.inf, 0.0, 0
        self._late: _Late | None = None
        self._on = self._ends = False
        self._plan_begin, self._plan_s = 0, list[float]()
        self._total, self._at_end = 0, list[Standstill]()
        self.found: list[Standstill] = []

    def begin(self, taken: int, now: float) -> None:
        """Record that the machine stands, and what it stands for is over."""
        self._plan_s = []  # the job may have grown
        self._taken.clear()
        self._taken.append((taken, now))
        self._rested, self._late, self._on, self._ends = taken, None, True, False
        self._rested_s = now
        self._ends_s, self._held_s, self._waited = now + _BEGIN_S, 0.0, 0

    def end_at_rest(self) -> None:
        """Record that the print is being held: what stands behind the next rest is meant to."""
        self._ends = True

    def answered(self, lines: Sequence[bytes], taken: int, now: float, resent: int = 0) -> None:
        """Record that ``taken`` lines of the job were taken by ``now``, s.

        ``resent``: lines sent again so far: one that was had not arrived before.
        """
        if not self._on or taken == self._taken[-1][0]:
            return
        line, before_s = self._taken[-1]
        self._total = len(lines)
        reached = self._reached(line, taken, resent)
        waits = now - before_s > SHORTEST_S and taken > line
        if waits and any(_UNBOUNDED.match(one) for one in lines[line:taken]):
            self.begin(taken, now)
            return
        if self._by_time:
            self._plan_on(lines, taken, reached, now)
        elif waits and now - before_s > self._usual_s(lines, line, taken) + SHORTEST_S:
            if self._late is not None:  # nothing more is learnt of the one before
                self._judge(lines, self._late, full=False)
            self._late = _Late(line, reached, before_s, now, self._is_full())
            self._taken.append((taken, now))
            return
        self._taken.append((taken, now))
        if self._late is not None:
            self._look_behind(lines, self._late)

    def _reached(self, line: int, taken: int, resent: int) -> int:
        """Return job lines that may have arrived when ``line`` of ``taken`` were answered."""
        again, self._resent = resent > self._resent, resent
        return line if again else taken

    def overdue(self, lines: Sequence[bytes], now: float) -> bool:
        """Whether the next line's answer is late by plan."""
        line, before_s = self._taken[-1] if self._taken else (len(lines), now)
        if not self._on or any(_UNBOUNDED.match(one) for one in lines[line : line + 1]):
            return False
        return line < len(lines) and now - before_s > _LATE_S + self._usual_s(lines, line, line + 1)

    def all_made(self, lines: Sequence[bytes], now: float) -> bool:
        """Whether all that was taken or sent has ended by plan, though nothing says so."""
        if not self._on:
            return False
        line, before_s = self._taken[-1]
        end = min(line + self._printer.lines_in_flight, len(lines))
        first = max(line - self._shifts[-1], 0)
        if any(_UNBOUNDED.match(one) for one in lines[first:end]):
            return False
        ahead_s = self._ahead_s(lines, line, full=True) + self._sum(lines, line, end)
        return now - before_s > ahead_s

    def standing(self, lines: Sequence[bytes], now: float) -> Standstill | None:
        """Return for how long by plan, and where, the motors stand; None where no plan tells."""
        if not self._on:
            return None
        line, before_s = self._taken[-1]
        end = min(line + self._printer.lines_in_flight, len(lines))
        if any(_UNBOUNDED.match(one) for one in lines[max(line - self._shifts[-1], 0) : end]):
            return None
        stood_s = now - before_s - self._ahead_s(lines, line, self._is_full())
        stood_s -= self._sum(lines, line, end)
        return Standstill(line, end, stood_s) if stood_s > 0.0 else None

    def without_host(self, lines: Sequence[bytes], taken: int, seconds: float) -> None:
        """Record that nobody spoke for so long to the printer, which had taken so many lines."""
        self._note(taken, taken, seconds - self._sum(lines, taken - self._held, taken))

    def rest(self, lines: Sequence[bytes], taken: int, now: float, resent: int = 0) -> None:
        """Record that all was made by ``now``, s, and the machine stands, or is led away."""
        if self._on:
            ends, (line, before_s) = self._ends, self._taken[-1]
            self._total = len(lines)
            reached = self._reached(line, taken, resent)
            if self._late is not None:
                self._judge(lines, self._late, full=False)
            if not any(_UNBOUNDED.match(one) for one in lines[line:taken]):
                spent = self._ahead_s(lines, line, self._is_full()) + self._sum(lines, line, taken)
                self._note(line, reached, now - before_s - spent)
            self._look_at_end(lines, now - before_s)
            self.begin(taken, now)
            self._on = not ends

    # --- judging a late answer --------------------------------------------------------------------

    def _plan_on(self, lines: Sequence[bytes], taken: int, reached: int, now: float) -> None:
        """Add an answer's moves to those ahead of a firmware that plans by time; judge it."""
        line, before_s = self._taken[-1]
        ends_s = self._ends_s + self._sum(lines, line, reached)
        if now > ends_s:
            if now - before_s > SHORTEST_S:
                self._note(line, reached, now - ends_s)
            self._ends_s = now + _BEGIN_S + self._sum(lines, reached, taken)
            return
        if now - before_s > _TURNAROUND_S:  # it waited until there was room
            self._waited += 1
            if math.isinf(self._ends_s):
                self._waited, self._held_s = _MEASURED + 1, _UNMEASURED_S
            if self._waited <= _MEASURED:
                self._held_s = max(self._held_s, self._ends_s - now)
            else:
                self._ends_s = now + self._held_s
        self._ends_s += self._sum(lines, line, taken)

    def _usual_s(self, lines: Sequence[bytes], line: int, taken: int) -> float:
        """Return how long the answer to lines behind ``line`` may take, s."""
        own = lines[line:taken]
        plan = self._sum(lines, line, taken) if any(one[:2] in (b"G2", b"G3", b"G4")
                                                    for one in own) else 0.0  # fmt: skip
        if not all(is_motion(one) for one in own):  # it may wait for all moves
            return self._ahead_s(lines, line, full=True) + plan
        if self._rested is not None and line - self._rested < self._shifts[0]:
            return plan  # there is room in the planner
        return plan + max(
            self._sum(lines, line - shift, taken - shift) for shift in self._shifts
        )  # fmt: skip

    def _look_behind(self, lines: Sequence[bytes], late: _Late) -> None:
        """Judge a late answer once the answers behind it show what became of the planner."""
        behind = [one for one in self._taken if one[1] >= late.came_s]
        if any(not is_motion(one) for one in lines[late.line : behind[-1][0]]):
            self._judge(lines, late, full=False)
        elif self._is_full(after_s=late.came_s):
            self._judge(lines, late, full=late.was_full)
        elif behind[-1][0] - late.line > self._shifts[-1] + 1:
            self._judge(lines, late, full=False)

    def _judge(self, lines: Sequence[bytes], late: _Late, full: bool) -> None:
        """Note the standstill; ``full``: the planner is as full as it was before it."""
        self._late = None
        if full:
            taken, now = self._taken[-1]
            spent = max(
                self._sum(lines, late.line - shift, taken - shift) for shift in self._shifts
            )
            held = self._shifts[0] - self._taken_at_once(late.came_s)
            if held > self._shifts[0] / 2:  # the planner stayed full: the motors stood in a move
                line = max(late.line - self._shifts[0] - 1, 0)
                self._note(line, line + 1, now - late.before_s - spent)
            else:
                self._note(late.line, late.reached, now - late.before_s - spent)
            return
        stood_s = late.came_s - late.before_s - self._ahead_s(lines, late.line, late.was_full)
        self._note(late.line, late.reached, stood_s)
        if stood_s > 0.0:
            self._rested, self._rested_s = late.line, late.came_s

    def _taken_at_once(self, after_s: float) -> int:
        """Return how many lines the planner had room for behind a late answer."""
        times = [one for one in self._taken if one[1] >= after_s]
        return sum(b[0] - a[0] for a, b in pairwise(times) if b[1] - a[1] <= _TURNAROUND_S)

    def _note(self, line: int, last: int, seconds: float) -> None:
        if seconds > SHORTEST_S:
            where = self._at_end if last == self._total else self.found
            where.append(Standstill(line, last, seconds))

    def _look_at_end(self, lines: Sequence[bytes], rested_s: float) -> None:
        """Tell those that may be behind the job's last move, unless all was made by then.

        ``rested_s``: from the last answer to the rest: less than the moves in flight take is proof.
        """
        for one in self._at_end:
            left_s = self._sum(lines, one.line, one.last) / (1.0 + MODEL_ERROR) ** 2
            if one.line < one.last and rested_s >= left_s:
                self.found.append(one)
        self._at_end.clear()

    # --- what the moves take ----------------------------------------------------------------------

    def _is_full(self, after_s: float = -math.inf) -> bool:
        """Whether the last two answers, since the last rest, each waited for a move to end."""
        after_s = max(after_s, self._rested_s)
        times = [(line, at) for line, at in self._taken if at >= after_s][-3:]
        return len(times) == 3 and all(b[1] - a[1] > _TURNAROUND_S for a, b in pairwise(times))

    def _ahead_s(self, lines: Sequence[bytes], line: int, full: bool) -> float:
        """Return the time of the moves ahead when ``line`` lines were taken, s."""
        if self._by_time:
            return max(self._ends_s - self._taken[-1][1], 0.0)
        first = max(line - self._held, 0)
        most = self._sum(lines, first, line)
        if full or self._rested is None or self._rested < self._taken[0][0]:
            return most
        ends = before_s = 0.0
        for (a, _), (b, at) in pairwise(self._taken):
            if b > line:
                break
            ends, before_s = max(ends, at) + self._sum(lines, a, b), at
        return min(most, max(ends - before_s, 0.0))

    def _sum(self, lines: Sequence[bytes], first: int, end: int) -> float:
        """Return the planned time of ``lines[first:end]``, s, and its error on top."""
        first = max(first, 0)
        if end <= first:
            return 0.0
        if not self._plan_begin <= first < end <= self._plan_begin + len(self._plan_s):
            self._make_plan(lines, min(first, max(end - self._shifts[-1] - 1, 0)), end)
        begin = self._plan_begin
        return (1.0 + MODEL_ERROR) * sum(self._plan_s[first - begin : end - begin])

    def _make_plan(self, lines: Sequence[bytes], first: int, end: int) -> None:
        """Plan lines to be asked about: what each takes, s."""
        begin, end = max(first - 2, 0), min(end + 2, len(lines))
        moves = planned_moves(lines, begin, end, modal_state(lines, begin), self._printer)
        starts = motion_of(moves, self._printer).starts
        self._plan_begin = begin
        self._plan_s = [_dwell_s(one) if one.startswith(b"G4 ") else 0.0
                        for one in lines[begin:end]]  # fmt: skip
        for move, (a, b) in zip(moves, pairwise(starts), strict=True):
            self._plan_s[move.line - begin] += math.inf if move.length_mm >= FAR_MM else b - a


def _dwell_s(line: bytes) -> float:
    words = read_sent(line)
    return (words.number("S") or 0.0) + (words.number("P") or 0.0) / 1000.0
