"""Find the next job line at which to pause, inspect, change the syringe or check the position."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from enum import Enum, auto
from typing import Final

from printctl.machine.job.care import Care
from printctl.machine.job.look_places import LookPlaces, Written, look_places
from printctl.machine.job.marks import Mark, MarkKind, Marks, Position, behind

_AHEAD: Final = 2
"""Most lines in flight: a mark nearer than that may be passed before it is looked at."""
_ENDS: Final = (MarkKind.LAYER, MarkKind.VESSEL)
_PAUSES: Final = (*_ENDS, MarkKind.RELOAD)
"""Where the needle has left the ink: a pause within a vessel is made only where it is asked for."""


class DueTask(Enum):
    """What is to be done between two lines."""

    NOTHING = auto()
    LOOK = auto()
    RELOAD = auto()
    PAUSE = auto()
    DEADMAN = auto()
    CHECKPOINT = auto()


class Watch:
    """Knows which mark comes next at which something is to be done.

    Parameters
    ----------
    marks : Marks
    care : Care
    lines : sequence of bytes
        The (grown) job's, needed where a look is due by what was written.
    inserts : sequence of (after, count)
        Which of them were put in.

    Attributes
    ----------
    after : MarkKind or None
        What the user wants ended before the next pause.
    confirmed : float, s
        When somebody was last heard of; any thread may set it.
    reload_at, reload_heads : tuple of int
        As in `Care`.
    unobserved : bool
        Whether the print goes on without an observer; any thread may set it.
    """

    def __init__(
        self,
        marks: Marks,
        care: Care,
        lines: Sequence[bytes] = (),
        inserts: Sequence[Position] = (),
    ) -> None:
        self.marks, self.care = marks, care
        self.after: MarkKind | None = None
        self.confirmed = self._checkpoint_due = 0.0
        self.reload_at, self.reload_heads = care.reload_at, care.reload_heads
        self._seen = self._looked = -1
        self._look_due, self._looked_at = math.inf, Written()
        self._look_again = self.unobserved = False
        self._look_behind = self._looked_behind = -1
        self._places = LookPlaces([], [], [])
        if care.looks_by_writing:
            within = bool(care.look_every_mm or care.look_every_written_s)
            self._places = look_places(lines, marks, inserts, within=within)

    def begin(self, now: float) -> None:
        """Start counting time."""
        self.confirmed = now
        self._checkpoint_due = now + (self.care.checkpoint_s or 0.0)
        self._count_to_look(now)

    def confirm(self, now: float) -> None:
        """Take notice that somebody is there; from any thread."""
        self.confirmed = now

    def pause_after(self, kind: MarkKind | None) -> None:
        """Have the print held after the next mark of a kind; None for no longer."""
        self.after = kind

    def plan(self, reload_at: tuple[int, ...], reload_heads: tuple[int, ...]) -> None:
        """Plan the changes of syringe that are still to come."""
        self.reload_at, self.reload_heads = reload_at, reload_heads

    def deadman_left(self, now: float) -> float | None:
        """Seconds until somebody must confirm; None for an attended print."""
        if not self.care.deadman_s:
            return None
        return max(0.0, self.confirmed + self.care.deadman_s - now)

    def next_stop(self, now: float, done: int, idle: bool, total: int) -> int:
        """Command lines after which to look at `due` again; ``total`` when there is nothing.

        Parameters
        ----------
        now : float, s
        done : int
            Command lines taken.
        idle : bool
            Whether nothing is in flight.
        total : int
            Command lines of the job.
        """
        first = done + (1 if idle else _AHEAD)
        wanted = [mark.index for mark in self._wanted(now, first) if mark is not None]
        wanted += self._next_look(now, first)
        place = bisect_left(self.reload_at, first)
        wanted += self.reload_at[place : place + 1]
        if self._overdue(now) and not self._any_from(first):
            wanted.append(first)
        return min([*wanted, total])

    def due(self, now: float, done: int) -> DueTask:
        """What is to be done now, with nothing in flight after ``done`` lines."""
        kinds = {mark.kind for mark in self.marks.here(done)}
        if self._wants_look(now, done, kinds):
            return DueTask.LOOK
        if done in self.reload_at or (self.after is MarkKind.RELOAD and self.after in kinds):
            return DueTask.RELOAD
        if self.after in kinds:
            return DueTask.PAUSE
        if self._overdue(now) and (kinds - {MarkKind.PART} or not self._any_from(done)):
            return DueTask.DEADMAN
        if self._wants_checkpoint(now) and done != self._seen and kinds & set(_ENDS):
            return DueTask.CHECKPOINT
        return DueTask.NOTHING

    def paused(self, done: int) -> None:
        """Take notice that the print is held after ``done`` lines, for whatever reason."""
        self.after = None
        left = [k for k, index in enumerate(self.reload_at) if index > done]
        self.reload_heads = tuple(self.reload_heads[k] for k in left if self.reload_heads)
        self.reload_at = tuple(self.reload_at[k] for k in left)

    def looked(self, now: float, done: int) -> None:
        """Take notice that a look after ``done`` lines was decided."""
        self._looked, self._look_again = done, False
        if 0 <= self._look_behind <= done:
            self._looked_behind, self._look_behind = self._look_behind, -1
        self._looked_at = self._places.at(done)
        self._count_to_look(now)

    def look_again(self) -> None:
        """Have the look made here that nobody has decided, or that failed."""
        self._look_again = True

    def look_behind(self, done: int) -> None:
        """Have a look made after ``done`` lines, where an insert ends."""
        self._look_behind = done

    def is_behind_insert(self, done: int) -> bool:
        """Whether a look after ``done`` lines is due, or was made, since an insert ends there."""
        return done in (self._look_behind, self._looked_behind)

    def grow(self, marks: Marks, after: int, count: int) -> None:
        """Take notice that ``count`` lines were put into the job behind the first ``after``."""
        self.marks, self._places = marks, self._places.shifted(after, count)
        self.reload_at = tuple(behind(index, after, count) for index in self.reload_at)

    def reload_head(self, done: int) -> int | None:
        """Whose syringe is to be changed after ``done`` lines, of several heads; None else."""
        if done not in self.reload_at or not self.reload_heads:
            return None
        return self.reload_heads[self.reload_at.index(done)]

    def checked(self, now: float, done: int) -> None:
        """Take notice that a checkpoint was made."""
        self._seen, self._checkpoint_due = done, now + (self.care.checkpoint_s or 0.0)

    def _count_to_look(self, now: float) -> None:
        every_s = self.care.look_every_s
        self._look_due = now + every_s if every_s else math.inf

    def _wants_look(self, now: float, done: int, kinds: set[MarkKind]) -> bool:
        """Whether a look is due after ``done`` lines, where marks of these kinds stand."""
        if self._look_again or done == self._look_behind:
            return True
        if done == self._looked:
            return False
        by_mark = bool(self._look_kinds & kinds) or (bool(kinds) and now >= self._look_due)
        return by_mark or self._places.next_due(done, self._looked_at, self.care) == done

    @property
    def _look_kinds(self) -> set[MarkKind]:
        """Marks at each of which a look is due; looks after vessels are due within them, too."""
        after = self.care.look_after
        parts = {MarkKind.PART} if after is MarkKind.VESSEL else set()
        return parts | {after} if after else set()

    def _next_look(self, now: float, first: int) -> list[int]:
        """Lines ahead after which a look may be due."""
        marks = [self.marks.next(kind, first) for kind in self._look_kinds]
        if now >= self._look_due:
            marks += [self.marks.next(kind, first) for kind in MarkKind]
        far = self._places.next_due(first, self._looked_at, self.care)
        ends = [self._look_behind] if self._look_behind >= first else []
        ends += [] if far is None else [far]
        return [mark.index for mark in marks if mark is not None] + ends

    def _wanted(self, now: float, first: int) -> list[Mark | None]:
        marks = [self.marks.next(self.after, first)] if self.after else []
        if self._overdue(now):
            marks += [self.marks.next(kind, first) for kind in _PAUSES]
        if self._wants_checkpoint(now):
            marks += [self.marks.next(kind, first) for kind in _ENDS]
        return marks

    def _any_from(self, index: int) -> bool:
        return any(self.marks.next(kind, index) is not None for kind in _PAUSES)

    def _overdue(self, now: float) -> bool:
        return self.deadman_left(now) == 0.0

    def _wants_checkpoint(self, now: float) -> bool:
        return self.care.checkpoint_s is not None and now >= self._checkpoint_due
