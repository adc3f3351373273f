"""Find the next job line at which to pause, inspect, change the syringe or check the position."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence, Set
from enum import Enum, auto
from typing import Final

from printctl.machine.job.care import Care
from printctl.machine.job.look_places import LookPlaces, Written, look_places
from printctl.machine.job.marks import MarkKind, Marks, Position, behind

_AHEAD: Final = 2
"""Most lines in flight: a mark nearer than that may be passed before it is looked at."""
_ENDS: Final = frozenset({MarkKind.LAYER, MarkKind.VESSEL})
_PAUSES: Final = _ENDS | {MarkKind.RELOAD}
"""Where the needle has left the ink: a pause within a vessel is made only where it is asked for."""


class DueTask(Enum):
    """Task between two lines."""

    NOTHING = auto()
    LOOK = auto()
    RELOAD = auto()
    PAUSE = auto()
    DEADMAN = auto()
    CHECKPOINT = auto()


_Task = tuple[DueTask, Set[MarkKind], tuple[int, ...]]


class Watch:
    """Marks and times at which something is to be done.

    ``lines`` of the (grown) job, and which of them are ``inserts``, are needed where a look is due
    by what was written.
    """

    def __init__(
        self,
        marks: Marks,
        care: Care,
        lines: Sequence[bytes] = (),
        inserts: Sequence[Position] = (),
    ) -> None:
        self.marks, self.care = marks, care
        self.after: MarkKind | None = None  # what the user wants ended before the next pause
        self.confirmed = 0.0  # s: when somebody was last heard of; any thread may set it
        self.reload_at, self.reload_heads = care.reload_at, care.reload_heads
        self.unobserved = False  # the print goes on without an observer; any thread may set it
        self.look_again = False  # make the look here that wasn't decided, or that failed
        self.insert_end = -1  # lines after which an insert ends that wants a look
        self._insert_looked, self._checkpoint_due = -1, 0.0
        self._checked = self._looked = -1
        self._look_due, self._looked_at = math.inf, Written()
        self._places = LookPlaces([], [], [])
        if care.looks_by_writing:
            within = bool(care.look_every_mm or care.look_every_written_s)
            self._places = look_places(lines, marks, inserts, within=within)

    def begin(self, now: float) -> None:
        """Start counting time."""
        self.confirmed = now
        self._checkpoint_due = now + (self.care.checkpoint_s or 0.0)
        self._count_to_look(now)

    def deadman_left(self, now: float) -> float | None:
        """Seconds until somebody must confirm; None for an attended print."""
        if not self.care.deadman_s:
            return None
        return max(0.0, self.confirmed + self.care.deadman_s - now)

    def next_stop(self, now: float, done: int, idle: bool, total: int) -> int:
        """Return after which of ``total`` lines to look at `due` again; ``done`` are taken.

        ``idle``: nothing is in flight.
        """
        first = done + (1 if idle else _AHEAD)
        stops = [total]
        for _, kinds, lines in self._tasks(now, first):
            marks = [self.marks.next(kind, first) for kind in kinds]
            stops += [mark.index for mark in marks if mark is not None]
            stops += [line for line in lines if line >= first]
        return min(stops)

    def due(self, now: float, done: int) -> DueTask:
        """Return what is to be done now, with nothing in flight after ``done`` lines."""
        if self.look_again or done == self.insert_end:
            return DueTask.LOOK
        here = {mark.kind for mark in self.marks.here(done)}
        did = {DueTask.LOOK: self._looked, DueTask.CHECKPOINT: self._checked}
        for task, kinds, lines in self._tasks(now, done):
            if (here & kinds or done in lines) and done != did.get(task):
                return task
        return DueTask.NOTHING

    def _tasks(self, now: float, first: int) -> Iterator[_Task]:
        """Yield tasks in their order, with the marks and lines from ``first`` on for them."""
        after, looks = self.care.look_after, set[MarkKind]()
        if after:
            looks = {after, MarkKind.PART} if after is MarkKind.VESSEL else {after}
        if now >= self._look_due:
            looks = set(MarkKind)
        written = self._places.next_due(first, self._looked_at, self.care)
        yield DueTask.LOOK, looks, (self.insert_end, *(() if written is None else (written,)))
        paused = {self.after} if self.after else set[MarkKind]()
        yield DueTask.RELOAD, paused & {MarkKind.RELOAD}, self.reload_at
        yield DueTask.PAUSE, paused, ()
        if self.deadman_left(now) == 0.0:
            none_left = all(self.marks.next(kind, first) is None for kind in _PAUSES)
            yield DueTask.DEADMAN, _PAUSES, (first,) if none_left else ()
        if self.care.checkpoint_s is not None and now >= self._checkpoint_due:
            yield DueTask.CHECKPOINT, _ENDS, ()

    def reload_head(self, done: int) -> int | None:
        """Whose syringe is to be changed after ``done`` lines, of several heads; None else."""
        if done not in self.reload_at or not self.reload_heads:
            return None
        return self.reload_heads[self.reload_at.index(done)]

    def is_behind_insert(self, done: int) -> bool:
        """Whether a look after ``done`` lines is due, or was made, since an insert ends there."""
        return done in (self.insert_end, self._insert_looked)

    def paused(self, done: int) -> None:
        """Record that the print is held after ``done`` lines, for whatever reason."""
        self.after = None
        left = [k for k, index in enumerate(self.reload_at) if index > done]
        self.reload_heads = tuple(self.reload_heads[k] for k in left if self.reload_heads)
        self.reload_at = tuple(self.reload_at[k] for k in left)

    def looked(self, now: float, done: int) -> None:
        """Record that a look after ``done`` lines was decided."""
        self._looked, self.look_again = done, False
        if 0 <= self.insert_end <= done:
            self._insert_looked, self.insert_end = self.insert_end, -1
        self._looked_at = self._places.at(done)
        self._count_to_look(now)

    def _count_to_look(self, now: float) -> None:
        every_s = self.care.look_every_s
        self._look_due = now + every_s if every_s else math.inf

    def checked(self, now: float, done: int) -> None:
        """Record that a checkpoint was made."""
        self._checked, self._checkpoint_due = done, now + (self.care.checkpoint_s or 0.0)

    def grow(self, marks: Marks, after: int, count: int) -> None:
        """Record that ``count`` lines were put into the job behind the first ``after``."""
        self.marks, self._places = marks, self._places.shifted(after, count)
        self.reload_at = tuple(behind(index, after, count) for index in self.reload_at)
