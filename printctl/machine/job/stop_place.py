"""Find the job line under way at a stop, from the position that the printer reported then."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from gcode.reading import code_of, is_motion
from printctl.machine.job.coordinates import Modal, declared_axes, modal_state
from printctl.machine.job.syringes import plunger_travel

NEAR_MM: Final = 0.02
"""Distance of a place of two decimals and whole steps from the move that it is on."""
NEAR_E_MM: Final = 0.006
_END_SHARE: Final = 1e-3
"""Share of a move so near to its beginning or end counts as that."""
_ARCS: Final = (b"G2", b"G3")


@dataclass(frozen=True)
class StopPlace:
    """Where in a job a printer stood."""

    line: int  # command lines that were wholly made; the next is to be gone on with
    at: Modal | None  # where that line is to be gone on from; None for its own beginning
    certain: bool  # no other line fits; else ``line`` is the first that may have been under way


@dataclass(frozen=True)
class _Passing:
    """A move that passes the place, at a share of its way."""

    line: int
    share: float
    e: float | None


def find_stop_line(lines: Sequence[bytes], sure: int, done: int, place: Modal) -> StopPlace:
    """Find the line that a printer was at which says that it stands at ``place``.

    ``sure`` lines of the job were certainly made, ``done`` were taken.
    """
    sure = next((k for k in range(sure, done) if is_motion(lines[k])), done)
    window = range(sure, done)
    if any(_renames(lines, k) or code_of(lines[k]) in _ARCS for k in window):
        return StopPlace(sure, None, False)
    if not window:
        return StopPlace(done, None, True)
    spots = _spots(_passing(lines, done, window, place), lines)
    if not spots:
        return StopPlace(sure, None, False)
    on = spots[0]
    whole = on.share > 1 - _END_SHARE
    line = on.line + 1 if whole else on.line
    at = modal_state(lines, line)
    if not whole:
        at = Modal(place.x, place.y, place.z, at.e if on.e is None else on.e, at.f)
    return StopPlace(line, at, len(spots) == 1)


def _renames(lines: Sequence[bytes], index: int) -> bool:
    """Whether a line calls a place another: M114 may have been answered in either count."""
    declared = declared_axes(lines[index])
    at = modal_state(lines, index).place() if declared else {}
    renamed = any(at.get(axis.lower()) != mm for axis, mm in declared.items())
    return renamed or code_of(lines[index]) == b"G28"


def _passing(
    lines: Sequence[bytes], done: int, window: Sequence[int], place: Modal
) -> list[_Passing]:
    """Return the moves that pass the place, with E in their own count or in the last one.

    A ``G92 E`` sets the count when it is read (old firmwares), or when its turn has come among the
    moves, and never where those are dropped (Marlin 2).
    """
    travel, passing, last = plunger_travel(lines), list[_Passing](), modal_state(lines, done).e
    for index in window:
        here, places = modal_state(lines, index).e, [place]
        if place.e is not None and here is not None and last is not None:
            places.append(
                replace(place, e=place.e + (here - travel[index]) - (last - travel[done]))
            )
        passed = (_pass(lines, index, there) for there in places)
        passing += [on for on in passed if on is not None][:1]
    return passing


def _pass(lines: Sequence[bytes], index: int, place: Modal) -> _Passing | None:
    """Return where the move of a line passes the place; None where it doesn't."""
    if not is_motion(lines[index]):
        return None
    begin, end = modal_state(lines, index), modal_state(lines, index + 1)
    axes = [(getattr(begin, axis), getattr(end, axis), getattr(place, axis)) for axis in "xyz"]
    if any(mm is None for axis in axes for mm in axis):
        return None
    length = math.dist([b for b, _, _ in axes], [e for _, e, _ in axes])
    if length < NEAR_MM:
        near = math.dist([b for b, _, _ in axes], [p for _, _, p in axes]) <= NEAR_MM
        return _push(begin.e, end.e, place.e, index) if near else None
    share = sum((e - b) * (p - b) for b, e, p in axes) / length**2
    share = min(max(share, 0.0), 1.0)
    if math.dist([b + share * (e - b) for b, e, _ in axes], [p for _, _, p in axes]) > NEAR_MM:
        return None
    if begin.e is None or end.e is None:
        return _Passing(index, share, None)
    e_mm = begin.e + share * (end.e - begin.e)
    slack = NEAR_E_MM + abs(end.e - begin.e) * NEAR_MM / length
    if place.e is not None and abs(place.e - e_mm) > slack:
        return None
    return _Passing(index, share, e_mm)


def _push(
    begin: float | None, end: float | None, place: float | None, index: int
) -> _Passing | None:
    """Return the same for a move of the plunger alone, from and to E, mm."""
    if begin is None or end is None or place is None:
        return None
    low, high = sorted((begin, end))
    if not low - NEAR_E_MM <= place <= high + NEAR_E_MM:
        return None
    e = min(max(place, low), high)
    return _Passing(index, abs(e - begin) / (high - low) if high > low else 1.0, e)


def _spots(passing: Sequence[_Passing], lines: Sequence[bytes]) -> list[_Passing]:
    """Return one of each place on the way: an end and the next move's beginning are the same."""
    spots: list[_Passing] = []
    for on in passing:
        if spots:
            last = spots[-1]
            between = any(is_motion(lines[k]) for k in range(last.line + 1, on.line))
            if not (between or last.share < 1 - _END_SHARE or on.share > _END_SHARE):
                spots.pop()
        spots.append(on)
    return spots
