"""Detect standstills of the ink: time that the planned moves in flight don't explain.

A firmware answers a line when its planner has room for it: with a full planner, when a move ends.
So an answer that is later than the moves' plan says is suspicious. What the next answers show
decides: a board whose motors stood goes on at its old pace; one that was merely not heard has made
moves meanwhile and takes as many lines at once.

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
from printctl.link.completed_moves import moves_ahead
from printctl.link.modal import modal_state
from printctl.link.motor_run_on import motion_of
from printctl.link.planned_moves import planned_moves
from sim.reading import is_motion, read_sent

SHORTEST_S: Final = 1.0
MODEL_ERROR: Final = 0.05
"""Share by which moves may take longer than planned; the dry run is within 3 %."""
_TURNAROUND_S: Final = 0.05
"""An answer within this waited for no move."""
_BUFFER_S: Final = 3.0
"""Most that a firmware which plans by time (Klipper) holds ahead, beside the last moves."""
_BUFFER_MOVES: Final = 3
_UNBOUNDED: Final = re.compile(
    rb"(?!SET_)[A-Z]{2}|T|G(28|29|30|32)\b|M(0|1|6|109|116|190|191|226|291|303|600)\b"
)
"""Lines that nobody knows the time of: homing, waits for heat or for a person, changes of tool."""


@dataclass(frozen=True)
class Standstill:
    """Time in which the ink stood still.

    Attributes
    ----------
    line : int
        Job lines before its place.
    seconds : float, s
    """

    line: int
    seconds: float


@dataclass(frozen=True)
class _Late:
    """A late answer that is still to be judged: the lines before it, when they and it came, s."""

    line: int
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
        self._held = _BUFFER_MOVES if self._by_time else printer.planner_blocks - 1
        self._shifts = range(_BUFFER_MOVES + 1) if self._by_time else range(
            max(self._held - 1, 0), int(ahead) + 1
        )  # fmt: skip
        self._taken: deque[tuple[int, float]] = deque(maxlen=2 * self._shifts[-1] + 8)
        self._rested: int | None = None
        self._late: _Late | None = None
        self._on = self._ends = False
        self._plan_begin, self._plan_s = 0, list[float]()
        self.found: list[Standstill] = []

    def begin(self, taken: int, now: float) -> None:
        """Record that the machine stands, and what it stands for is over."""
        self._plan_s = []  # the job may have grown
        self._taken.clear()
        self._taken.append((taken, now))
        self._rested, self._late, self._on, self._ends = taken, None, True, False

    def end_at_rest(self) -> None:
        """Record that the print is being held: what stands behind the next rest is meant to."""
        self._ends = True

    def answered(self, lines: Sequence[bytes], taken: int, now: float) -> None:
        """Record that ``taken`` lines of the job were taken by ``now``, s."""
        if not self._on or taken == self._taken[-1][0]:
            return
        line, before_s = self._taken[-1]
        if self._late is not None:
            self._taken.append((taken, now))
            self._look_behind(lines, self._late)
            return
        late_s = now - before_s
        if late_s > SHORTEST_S and taken > line:
            if any(_UNBOUNDED.match(one) for one in lines[line:taken]):
                self.begin(taken, now)
                return
            if late_s > self._usual_s(lines, line, taken) + SHORTEST_S:
                self._late = _Late(line, before_s, now, self._is_full())
        self._taken.append((taken, now))

    def rest(self, lines: Sequence[bytes], taken: int, now: float) -> None:
        """Record that all was made by ``now``, s, and the machine stands."""
        if self._on:
            ends, (line, before_s) = self._ends, self._taken[-1]
            if self._late is not None:
                self._judge(lines, self._late, full=False)
            elif not any(_UNBOUNDED.match(one) for one in lines[line:taken]):
                spent = self._ahead_s(lines, line, self._is_full())
                if self._by_time:  # some builds hold more
                    spent = max(spent, self._sum(lines, line - self._printer.planner_blocks, line))
                spent += self._sum(lines, line, taken)
                self._note(line, now - before_s - spent)
            self.begin(taken, now)
            self._on = not ends

    # --- judging a late answer --------------------------------------------------------------------

    def _usual_s(self, lines: Sequence[bytes], line: int, taken: int) -> float:
        """Return how long the answer to lines behind ``line`` may take, s."""
        own = lines[line:taken]
        plan = self._sum(lines, line, taken) if any(one[:2] in (b"G2", b"G3", b"G4")
                                                    for one in own) else 0.0  # fmt: skip
        if not all(is_motion(one) for one in own):  # it may wait for all moves
            return self._ahead_s(lines, line, full=True) + plan
        if self._by_time:
            return self._ahead_s(lines, line, full=True) - _BUFFER_S + plan
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
            place = max(late.line - self._shifts[0], 0)
            self._note(place, now - late.before_s - spent)
            return
        spent = self._ahead_s(lines, late.line, late.was_full)
        if self._note(late.line, late.came_s - late.before_s - spent):
            self._rested = late.line

    def _note(self, line: int, seconds: float) -> bool:
        stood = seconds > SHORTEST_S
        if stood:
            self.found.append(Standstill(line, seconds))
        return stood

    # --- what the moves take ----------------------------------------------------------------------

    def _is_full(self, after_s: float = -math.inf) -> bool:
        """Whether the last two answers each waited for a move to end."""
        times = [(line, at) for line, at in self._taken if at >= after_s][-3:]
        return len(times) == 3 and all(b[1] - a[1] > _TURNAROUND_S for a, b in pairwise(times))

    def _ahead_s(self, lines: Sequence[bytes], line: int, full: bool) -> float:
        """Return the time of the moves ahead when ``line`` lines were taken, s."""
        first = max(line - self._held, 0)
        most = self._sum(lines, first, line) + (_BUFFER_S if self._by_time else 0.0)
        if full or self._by_time or self._rested is None or self._rested < self._taken[0][0]:
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
            self._plan_s[move.line - begin] += b - a


def _dwell_s(line: bytes) -> float:
    words = read_sent(line)
    return (words.number("S") or 0.0) + (words.number("P") or 0.0) / 1000.0
