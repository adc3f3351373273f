"""Find the job line under way at a stop, from the position that the printer reported then.

Pure: the place that M114 told is looked for on the moves that may have been under way.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

from printctl.machine.job.coordinates import Modal, declared_axes, modal_state
from printctl.machine.job.syringes import plunger_travel
from sim.gcode.reading import code_of, is_motion

NEAR_MM: Final = 0.02
"""Distance of a place of two decimals and whole steps from the move that it is on."""
NEAR_E_MM: Final = 0.006
_ENDS: Final = 1e-3
"""Share of a move so near to its beginning or end counts as that."""
_ARCS: Final = (b"G2", b"G3")


@dataclass(frozen=True)
class StopPlace:
    """Where in a job a printer stood.

    Attributes
    ----------
    line : int
        Command lines that were wholly made; the next is to be gone on with.
    at : Modal or None
        Where that line is to be gone on from; None for its own beginning.
    certain : bool
        Whether no other line fits; else ``line`` is the first that may have been under way.
    """

    line: int
    at: Modal | None
    certain: bool


@dataclass(frozen=True)
class _On:
    """A move that passes the place, at a share of its way."""

    line: int
    share: float
    e: float | None


def find_stop_line(lines: Sequence[bytes], sure: int, done: int, place: Modal) -> StopPlace:
    """Find the line that a printer was at.

    Parameters
    ----------
    lines : sequence of bytes
        The job's.
    sure, done : int
        Lines that were certainly made, and those that were taken.
    place : Modal
        Where the printer says that it stands, mm.
    """
    sure = next((k for k in range(sure, done) if is_motion(lines[k])), done)
    window = range(sure, done)
    if any(_moves_frame(lines, k) or code_of(lines[k]) in _ARCS for k in window):
        return StopPlace(sure, None, False)
    if not window:
        return StopPlace(done, None, True)
    spots = _spots(_found(lines, done, window, place), lines)
    if not spots:
        return StopPlace(sure, None, False)
    on = spots[0]
    whole = on.share > 1 - _ENDS
    line = on.line + 1 if whole else on.line
    at = modal_state(lines, line)
    if not whole:
        e = at.e if on.e is None else on.e
        at = Modal(place.x, place.y, place.z, e, at.f)
    return StopPlace(line, at, len(spots) == 1)


def _moves_frame(lines: Sequence[bytes], index: int) -> bool:
    """Whether a line calls a place another: M114 may have been answered in either count."""
    told = declared_axes(lines[index])
    at = modal_state(lines, index).place() if told else {}
    renamed = any(at.get(axis.lower()) != mm for axis, mm in told.items())
    return renamed or code_of(lines[index]) == b"G28"


def _own_count(
    lines: Sequence[bytes], index: int, done: int, travel: Sequence[float], e: float | None
) -> float | None:
    """Return ``e``, mm, of the count after ``done`` lines in that of line ``index``."""
    here, last = modal_state(lines, index).e, modal_state(lines, done).e
    if e is None or here is None or last is None:
        return None
    return e + (here - travel[index]) - (last - travel[done])


def _found(lines: Sequence[bytes], done: int, window: Sequence[int], place: Modal) -> list[_On]:
    """Return the moves that pass the place, with E in their own count or in the last one.

    A ``G92 E`` sets the count when it is read (old firmwares), or when its turn has come among the
    moves, and never where those are dropped (Marlin 2).
    """
    travel, passing = plunger_travel(lines), list[_On]()
    for index in window:
        own = _own_count(lines, index, done, travel, place.e)
        places = (place, place if own is None else replace(place, e=own))
        passed = (_passes(lines, index, there) for there in places)
        passing += [on for on in passed if on is not None][:1]
    return passing


def _passes(lines: Sequence[bytes], index: int, place: Modal) -> _On | None:
    """Whether the move of a line passes the place, and where."""
    if not is_motion(lines[index]):
        return None
    begin, end = modal_state(lines, index), modal_state(lines, index + 1)
    known = [
        (b, e, p)
        for b, e, p in zip(_xyz(begin), _xyz(end), _xyz(place), strict=True)
        if b is not None and e is not None and p is not None
    ]
    if len(known) < 3:
        return None
    length = math.dist([b for b, _, _ in known], [e for _, e, _ in known])
    if length < NEAR_MM:
        return _pushes(begin, end, place, known, index)
    share = sum((e - b) * (p - b) for b, e, p in known) / length**2
    share = min(max(share, 0.0), 1.0)
    if math.dist([b + share * (e - b) for b, e, _ in known], [p for _, _, p in known]) > NEAR_MM:
        return None
    if begin.e is None or end.e is None:
        return _On(index, share, None)
    e_mm = begin.e + share * (end.e - begin.e)
    slack = NEAR_E_MM + abs(end.e - begin.e) * NEAR_MM / length
    if place.e is not None and abs(place.e - e_mm) > slack:
        return None
    return _On(index, share, e_mm)


def _pushes(
    begin: Modal, end: Modal, place: Modal, known: Sequence[tuple[float, float, float]], index: int
) -> _On | None:
    """The same for a move of the plunger alone."""
    here = math.dist([b for b, _, _ in known], [p for _, _, p in known]) <= NEAR_MM
    if not here or begin.e is None or end.e is None or place.e is None:
        return None
    low, high = sorted((begin.e, end.e))
    if not low - NEAR_E_MM <= place.e <= high + NEAR_E_MM:
        return None
    e = min(max(place.e, low), high)
    return _On(index, abs(e - begin.e) / (high - low) if high > low else 1.0, e)


def _spots(passing: Sequence[_On], lines: Sequence[bytes]) -> list[_On]:
    """Return one of each place on the way: an end and the next move's beginning are the same."""
    return list(_merged(passing, lines))


def _merged(passing: Sequence[_On], lines: Sequence[bytes]) -> Iterator[_On]:
    last: _On | None = None
    for on in passing:
        if last is not None:
            between = any(is_motion(lines[k]) for k in range(last.line + 1, on.line))
            if between or last.share < 1 - _ENDS or on.share > _ENDS:
                yield last
        last = on
    if last is not None:
        yield last


def _xyz(at: Modal) -> tuple[float | None, float | None, float | None]:
    return at.x, at.y, at.z
