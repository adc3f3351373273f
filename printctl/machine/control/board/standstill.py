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
from gcode.reading import is_motion
from printctl.machine.job.coordinates import modal_state
from printctl.machine.job.moves import FAR_MM, dwell_s, motion_of, moves_ahead, planned_moves

SHORTEST_S: Final = 1.0
MODEL_ERROR: Final = 0.05
"""Share by which moves may take longer than planned; the dry run is within 3 %."""
_LATE_S: Final = 0.3
_TURNAROUND_S: Final = 0.05
"""An answer within this waited for no move."""
_LOOKED_BACK: Final = 4
"""Answers by which is seen whether the planner is full."""
_MEASURED: Final = 3
"""Answers since a rest by which is measured how much such a firmware (Klipper) holds ahead."""
_UNMEASURED_S: Final = 2.25
"""As much where a move came from a place that is unknown."""
_BEGIN_S: Final = 0.25
"""Time for which such a firmware lets its first moves wait (Klipper: toolhead.py)."""
_UNBOUNDED: Final = re.compile(
    rb"(?!SET_)[A-Z]{2}|T|G(28|29|30|32)\b|M(0|1|6|109|116|190|191|226|291|303|600)\b"
)
"""Lines of unknown duration: homing, waits for heat or for a person, changes of tool."""


@dataclass(frozen=True)
class Standstill:
    """Time in which the ink stood still, s.

    ``line`` to ``last`` job lines were made before it: the place is between their ends.
    """

    line: int
    last: int
    seconds: float


@dataclass(frozen=True)
class _Late:
    """A late answer that is still to be judged.

    ``line`` job lines were taken before it, at ``before_s``; ``reached``: those, and what was in
    flight where it may have arrived before the answers failed. It came at ``came_s``.
    """

    line: int
    reached: int
    before_s: float
    came_s: float
    was_full: bool


class StandstillWatch:
    """Finds standstills (``found``) from the times at which a printer took the lines of a job."""

    def __init__(self, printer: Printer, lines: list[bytes]) -> None:
        self._printer, self._lines = printer, lines
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
        self._at_end, self.found = list[Standstill](), list[Standstill]()

    def grow(self, lines: list[bytes]) -> None:
        """Take the job with lines put in."""
        self._lines, self._plan_s = lines, []

    def begin(self, taken: int, now: float) -> None:
        """Record that the machine stands, and what it stands for is over."""
        self._taken.clear()
        self._taken.append((taken, now))
        self._rested, self._late, self._on, self._ends = taken, None, True, False
        self._rested_s = now
        self._ends_s, self._held_s, self._waited = now + _BEGIN_S, 0.0, 0
        self._plan_s = []  # a plan begins at a standstill

    def end_at_rest(self) -> None:
        """Record that the print is being held: what stands behind the next rest is meant to."""
        self._ends = True

    def lose_pace(self) -> None:
        """Record that moves take another time than planned: judge nothing until `begin`."""
        self._late, self._on = None, False
        self._at_end.clear()

    def drop(self, now: float) -> None:
        """Record that moves are dropped: a machine that went till now is meant to stand."""
        standing = self.standing(now)
        if standing is None or standing.seconds <= SHORTEST_S:
            if self._late is not None:
                self._judge(self._late, full=False)
            self.lose_pace()

    def answered(self, taken: int, now: float, resent: int) -> None:
        """Record that ``taken`` lines of the job were taken by ``now``, s.

        ``resent``: lines sent again so far: one that was had not arrived before.
        """
        if not self._on or taken == self._taken[-1][0]:
            return
        line, before_s = self._taken[-1]
        reached = self._reached(line, taken, resent)
        waits = now - before_s > SHORTEST_S and taken > line
        if waits and is_unbounded(self._lines, line, taken):
            self.begin(taken, now)
            return
        if self._by_time:
            self._plan_on(taken, reached, now)
        elif waits and now - before_s > self._usual_s(line, taken) + SHORTEST_S:
            if self._late is not None:  # nothing more is learnt of the one before
                self._judge(self._late, full=False)
            self._late = _Late(line, reached, before_s, now, self._is_full())
            self._taken.append((taken, now))
            return
        self._taken.append((taken, now))
        if self._late is not None:
            self._look_behind(self._late)

    def overdue(self, now: float) -> bool:
        """Whether the next line's answer is late by plan."""
        line, before_s = self._taken[-1] if self._taken else (len(self._lines), now)
        if not self._on or is_unbounded(self._lines, line, line + 1):
            return False
        late_s = now - before_s - _LATE_S
        return line < len(self._lines) and late_s > self._usual_s(line, line + 1)

    def all_made(self, now: float) -> bool:
        """Whether all that was taken or sent has ended by plan, though nothing says so."""
        end = self._end_in_flight()
        if end is None:
            return False
        line, before_s = self._taken[-1]
        return now - before_s > self._ahead_s(line, full=True) + self._sum(line, end)

    def standing(self, now: float) -> Standstill | None:
        """Return for how long by plan, and where, the motors stand; None where no plan tells."""
        end = self._end_in_flight()
        if end is None:
            return None
        line, before_s = self._taken[-1]
        stood_s = now - before_s - self._ahead_s(line, self._is_full()) - self._sum(line, end)
        return Standstill(line, end, stood_s) if stood_s > 0.0 else None

    def without_host(self, taken: int, seconds: float) -> None:
        """Record that no host spoke for so long to the printer, which had taken so many lines."""
        self._note(taken, taken, seconds - self._sum(taken - self._held, taken))

    def rest(self, taken: int, now: float, resent: int) -> None:
        """Record that all was made by ``now``, s, and the machine stands, or is led away."""
        if not self._on:
            return
        ends, (line, before_s) = self._ends, self._taken[-1]
        reached = self._reached(line, taken, resent)
        if self._late is not None:
            self._judge(self._late, full=False)
        if not is_unbounded(self._lines, line, taken):
            spent = self._ahead_s(line, self._is_full()) + self._sum(line, taken)
            self._note(line, reached, now - before_s - spent)
        # those behind the job's last move count unless all was made by then: less time from the
        # last answer to the rest than the moves in flight take is proof
        for one in self._at_end:
            left_s = self._sum(one.line, one.last) / (1.0 + MODEL_ERROR) ** 2
            if one.line < one.last and now - before_s >= left_s:
                self.found.append(one)
        self._at_end.clear()
        self.begin(taken, now)
        self._on = not ends

    def _reached(self, line: int, taken: int, resent: int) -> int:
        """Return job lines that may have arrived when ``line`` of ``taken`` were answered."""
        again, self._resent = resent > self._resent, resent
        return line if again else taken

    def _end_in_flight(self) -> int | None:
        """Return lines taken or in flight; None where no plan tells when they are made."""
        if not self._on:
            return None
        line = self._taken[-1][0]
        end = min(line + self._printer.lines_in_flight, len(self._lines))
        first = max(line - self._shifts[-1], 0)
        return None if is_unbounded(self._lines, first, end) else end

    # --- judging a late answer --------------------------------------------------------------------

    def _plan_on(self, taken: int, reached: int, now: float) -> None:
        """Add an answer's moves to those ahead of a firmware that plans by time; judge it."""
        line, before_s = self._taken[-1]
        ends_s = self._ends_s + self._sum(line, reached)
        if now > ends_s:
            if now - before_s > SHORTEST_S:
                self._note(line, reached, now - ends_s)
            self._ends_s = now + _BEGIN_S + self._sum(reached, taken)
            return
        if now - before_s > _TURNAROUND_S:  # it waited until there was room
            self._waited += 1
            if math.isinf(self._ends_s):
                self._waited, self._held_s = _MEASURED + 1, _UNMEASURED_S
            if self._waited <= _MEASURED:
                self._held_s = max(self._held_s, self._ends_s - now)
            else:
                self._ends_s = now + self._held_s
        self._ends_s += self._sum(line, taken)

    def _usual_s(self, line: int, taken: int) -> float:
        """Return how long the answer to lines behind ``line`` may take, s."""
        own = self._lines[line:taken]
        slow = any(one[:2] in (b"G2", b"G3", b"G4") for one in own)
        plan = self._sum(line, taken) if slow else 0.0
        if not all(is_motion(one) for one in own):  # it may wait for all moves
            return self._ahead_s(line, full=True) + plan
        if self._rested is not None and line - self._rested < self._shifts[0]:
            return plan  # there is room in the planner
        return plan + self._longest_shifted(line, taken)

    def _look_behind(self, late: _Late) -> None:
        """Judge a late answer once the answers behind it show what became of the planner."""
        last = self._taken[-1][0]
        if any(not is_motion(one) for one in self._lines[late.line : last]):
            self._judge(late, full=False)
        elif self._is_full(after_s=late.came_s):
            self._judge(late, full=late.was_full)
        elif last - late.line > self._shifts[-1] + 1:
            self._judge(late, full=False)

    def _judge(self, late: _Late, full: bool) -> None:
        """Note the standstill; ``full``: the planner is as full as it was before it."""
        self._late = None
        if full:
            taken, now = self._taken[-1]
            stood_s = now - late.before_s - self._longest_shifted(late.line, taken)
            held = self._shifts[0] - self._taken_at_once(late.came_s)
            if held > self._shifts[0] / 2:  # the planner stayed full: the motors stood in a move
                line = max(late.line - self._shifts[0] - 1, 0)
                self._note(line, line + 1, stood_s)
            else:
                self._note(late.line, late.reached, stood_s)
            return
        stood_s = late.came_s - late.before_s - self._ahead_s(late.line, late.was_full)
        self._note(late.line, late.reached, stood_s)
        if stood_s > 0.0:
            self._rested, self._rested_s = late.line, late.came_s

    def _taken_at_once(self, after_s: float) -> int:
        """Return how many lines the planner had room for behind a late answer."""
        times = [one for one in self._taken if one[1] >= after_s]
        return sum(b[0] - a[0] for a, b in pairwise(times) if b[1] - a[1] <= _TURNAROUND_S)

    def _note(self, line: int, last: int, seconds: float) -> None:
        if seconds > SHORTEST_S:
            where = self._at_end if last == len(self._lines) else self.found
            where.append(Standstill(line, last, seconds))

    # --- what the moves take ----------------------------------------------------------------------

    def _is_full(self, after_s: float = -math.inf) -> bool:
        """Whether two of the last four answers, since the last rest, waited for a move to end.

        Not each does where rows alternate with the short moves between them.
        """
        after_s = max(after_s, self._rested_s)
        times = [at for _, at in self._taken if at >= after_s][-_LOOKED_BACK - 1 :]
        return sum(b - a > _TURNAROUND_S for a, b in pairwise(times)) >= 2

    def _ahead_s(self, line: int, full: bool) -> float:
        """Return the time of the moves ahead when ``line`` lines were taken, s."""
        if self._by_time:
            return max(self._ends_s - self._taken[-1][1], 0.0)
        most = self._sum(line - self._held, line)
        if full or self._rested is None or self._rested < self._taken[0][0]:
            return most
        ends = before_s = 0.0
        for (a, _), (b, at) in pairwise(self._taken):
            if b > line:
                break
            ends, before_s = max(ends, at) + self._sum(a, b), at
        return min(most, max(ends - before_s, 0.0))

    def _longest_shifted(self, line: int, taken: int) -> float:
        """Return the longest time of as many moves that may be under way meanwhile, s."""
        return max(self._sum(line - shift, taken - shift) for shift in self._shifts)

    def _sum(self, first: int, end: int) -> float:
        """Return the planned time of lines ``first`` to ``end``, s, and its error on top."""
        first = max(first, 0)
        if end <= first:
            return 0.0
        if not self._plan_begin <= first < end <= self._plan_begin + len(self._plan_s):
            self._make_plan(min(first, max(end - self._shifts[-1] - 1, 0)), end)
        begin = self._plan_begin
        return (1.0 + MODEL_ERROR) * sum(self._plan_s[first - begin : end - begin])

    def _make_plan(self, first: int, end: int) -> None:
        """Plan lines: the time of each, s."""
        lines = self._lines
        begin, end = max(first - 2, 0), min(end + 2, len(lines))
        moves = planned_moves(lines, begin, end, modal_state(lines, begin), self._printer)
        starts = motion_of(moves, self._printer).starts
        dwells = (dwell_s(one) if one.startswith(b"G4 ") else 0.0 for one in lines[begin:end])
        self._plan_begin, self._plan_s = begin, list(dwells)
        for move, (a, b) in zip(moves, pairwise(starts), strict=True):
            self._plan_s[move.line - begin] += math.inf if move.length_mm >= FAR_MM else b - a


def is_unbounded(lines: Sequence[bytes], first: int, end: int) -> bool:
    """Whether any of ``lines[first:end]`` takes a time that no plan tells."""
    return any(_UNBOUNDED.match(one) for one in lines[first:end])
