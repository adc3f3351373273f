"""Find job lines where the print may be held for inspection; sum path and time before each.

A place is a mark, or, where looks within a layer are wanted, the end of a written line: what comes
next leaves the ink sideways, so the needle may rise there without a seam in the line. A path that
is written without leaving it is never interrupted. In a bath only marks say that the way straight
up is free, so ends of lines count in files that mark layers alone.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from gcode.reading import is_motion
from printctl.machine.job.care import Care
from printctl.machine.job.coordinates import Move, Spot, moves_of
from printctl.machine.job.marks import MarkKind, Marks, Position, behind


@dataclass(frozen=True)
class Written:
    """What a job has written before a place, without what was put into it.

    Counted are moves that push the plunger; of a job that never moves it (a pneumatic head's), all
    moves along X and Y. ``way_mm`` adds straight lengths, of an arc its chord; ``time_s`` is at the
    speeds that the job asks for; ``top_mm`` is the highest of them, -inf before the first.
    """

    way_mm: float = 0.0
    time_s: float = 0.0
    top_mm: float = -math.inf

    def after(self, move: Move) -> Written:
        """Return what is written after one more move."""
        way, begin, end = move.way_mm, move.begin, move.end
        seconds = way / (end.f / 60) if end.f > 0 else 0.0
        top_mm = max(self.top_mm, begin.z, end.z)
        return Written(self.way_mm + way, self.time_s + seconds, top_mm)


_ROUNDING_MM: Final = 1e-6
_FIRST_INTERVAL_S: Final = 10.0
"""Writing time to the first look, where looks are due by writing time, and to that behind a mend
or correction; from there each interval is as long as all before it, up to what was asked for."""


@dataclass(frozen=True)
class LookPlaces:
    """Places at which looks may be due, in the job's order.

    ``index`` are the command lines before each, ``written`` what is written there; ``marked`` tells
    marks from ends of lines within a layer. ``changed_s`` are writing times at which something was
    put into the job: what it cures may not be over.
    """

    index: list[int]
    written: list[Written]
    marked: list[bool]
    changed_s: tuple[float, ...] = ()

    def shifted(self, after: int, count: int) -> LookPlaces:
        """Return them with ``count`` lines put in behind the first ``after``."""
        index = [behind(one, after, count) for one in self.index]
        changed = (*self.changed_s, self.at(after).time_s)
        return LookPlaces(index, self.written, self.marked, changed)

    def at(self, done: int) -> Written:
        """Return what was written up to the last place at or before ``done``."""
        place = bisect_right(self.index, done)
        return self.written[place - 1] if place else Written()

    def next_due(self, first: int, looked: Written, care: Care) -> int | None:
        """Return the first place from ``first`` on by which enough is written since a look."""
        low, places = bisect_left(self.index, first), list[int]()
        if care.look_every_mm:
            least = looked.way_mm + care.look_every_mm
            places.append(bisect_left(self.written, least, low, key=lambda one: one.way_mm))
        if care.look_every_written_s:
            least = looked.time_s + self._interval_s(looked, care.look_every_written_s)
            places.append(bisect_left(self.written, least, low, key=lambda one: one.time_s))
        if care.look_every_height_mm and self.index:
            base = max(looked.top_mm, self.written[0].top_mm)  # at first the first layer's
            least = base + care.look_every_height_mm - _ROUNDING_MM
            high = bisect_left(self.written, least, low, key=lambda one: one.top_mm)
            places += [k for k in range(high, len(self.index)) if self.marked[k]][:1]
        due = min(places, default=len(self.index))
        return self.index[due] if due < len(self.index) else None

    def _interval_s(self, looked: Written, most_s: float) -> float:
        """Writing time from a look to the next: short where trouble is likely, or just seen."""
        since = looked.time_s - max(self.changed_s, default=0.0)
        return min(most_s, max(_FIRST_INTERVAL_S, since))


def look_places(
    lines: Sequence[bytes], marks: Marks, inserts: Sequence[Position], *, within: bool
) -> LookPlaces:
    """Return the places of a (grown) job's ``lines``.

    What its ``inserts`` write isn't counted. ``within`` is whether lines' ends within layers are
    wanted.
    """
    marked = sorted({mark.index for mark in marks.all})
    layers = bool(marks.of(MarkKind.LAYER)) and not marks.of(MarkKind.VESSEL)
    written = _read(lines, marked, inserts, ends_too=within and layers)
    known = set(marked)
    index = sorted(written)
    places = LookPlaces(index, [written[k] for k in index], [k in known for k in index])
    return replace(places, changed_s=tuple(places.at(after).time_s for after, _ in inserts))


def _read(
    lines: Sequence[bytes], marked: Sequence[int], inserts: Sequence[Position], *, ends_too: bool
) -> dict[int, Written]:
    """Return what is written before each mark and, where wanted, before each end of a line."""
    written, waiting = dict[int, Written](), list(reversed(marked))
    inserted = {k for after, count in inserts for k in range(after, after + count)}
    held = [after for after, count in reversed(inserts) if count]
    # Of a job that moves a plunger only what pushes it writes.
    by_plunger = any(b" E" in line and is_motion(line) for line in lines)
    now = Written()
    end: int | None = None  # of the line that was written last, where it may still come later
    wrote = False
    for move in moves_of(lines, at=Spot(0.0, 0.0, 0.0, 0.0, 0.0)):
        index, begin, to, _ = move
        while waiting and waiting[-1] <= index:
            written[waiting.pop()] = now
            end, wrote = None, False  # nothing is written from here to the next line's begin
        while held and held[-1] <= index:
            after = held.pop()
            end = after if wrote and end is None else end
        if index in inserted:
            continue
        aside = math.dist(begin[:2], to[:2]) > 0
        if to.e > begin.e and move.way_mm > 0 if by_plunger else aside:
            if end is not None and ends_too:
                written[end] = now
            end, wrote, now = None, True, now.after(move)
        elif by_plunger and to.e < begin.e:
            end = None  # it is better to rise behind it, off a wall and without pressure
        elif aside and wrote and end is None:
            end = index
    return written | dict.fromkeys(waiting, now)
