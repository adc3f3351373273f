"""Check lines to insert in a running print: allowed codes, limits, same position at the end.

A job's file is judged as a whole before its first line: codes by the gate, places, speeds and
heights by preflight. An insert comes in the middle of the print, so this is narrower than both. It
moves, pushes the plunger, waits, and counts the plunger anew; it sets nothing. It keeps to the
machine's travel, to the job's own least height and, below the job's greatest height, to what the
job's own moves stand on (`JobReach`), for which the job's checks hold.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from firmware_profiles import Printer
from printctl.machine.errors import JobError, Refused
from printctl.machine.job.insert_sums import InsertSums
from printctl.machine.job.job import parse_job
from printctl.machine.job.modal import Modal
from printctl.machine.job.reach import ASIDE_MM, JobReach
from printctl.machine.job.valve import is_about_valve, is_open
from sim.gcode.reading import GcodeLine, read_sent

MOST_LINES: Final = 20_000
LONGEST_WAIT_S: Final = 60.0
_MOVES: Final = ("G0", "G1")
_ALLOWED: Final = frozenset({*_MOVES, "G4", "G92", "G90", "G21", "M82", "M117", "M400"})
_SAME_MM: Final = 5e-4
_SAME_E_MM: Final = 1e-5
_TINY: Final = 1e-9
_LONGEST_PUSH_MM: Final = 200.0
"""Marlin's own limit of one move of the plunger (EXTRUDE_MAXLENGTH)."""
_AXES: Final = "xyz"


@dataclass(frozen=True)
class InsertPlace:
    """Where an insert begins.

    Attributes
    ----------
    at : Modal
        Where the print is held, mm.
    shift_mm : (x, y, z), mm
        What the job calls places there beyond the count of the machine's frame.
    reach : JobReach
    printer : Printer
    plunger_mm_s : float, mm/s
        Fastest that the ink bears; infinite where nobody named it.
    """

    at: Modal
    reach: JobReach
    printer: Printer
    plunger_mm_s: float = math.inf
    shift_mm: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0))


def judged_lines(texts: Sequence[str], place: InsertPlace, name: str) -> tuple[bytes, ...]:
    """Return an insert's lines as they are sent.

    Parameters
    ----------
    texts : sequence of str
    place : InsertPlace
    name : str
        What it is called in messages.

    Raises
    ------
    Refused
        With the first line that can't be sent and the reason, or with what isn't at its end as it
        was at its begin.
    """
    if not texts or len(texts) > MOST_LINES:
        raise Refused(f"{name} has {len(texts)} lines; it may have 1 to {MOST_LINES:,}")
    if any("\n" in text or "\r" in text for text in texts):
        raise Refused(
            f"{name} has a line end within a line; give each command as a line of its own"
        )
    try:
        job = parse_job("\n".join(texts).encode("ascii"), name, place.printer)
    except (JobError, UnicodeEncodeError) as exc:
        raise Refused(f"{name} isn't taken: {exc}") from exc
    if None in (place.at.x, place.at.y, place.at.z):
        raise Refused(f"{name} isn't taken: the job doesn't tell where the needle stands there")
    at, sums = place.at, InsertSums()
    for line, number in zip(job.lines, job.file_lines, strict=True):
        try:
            before, at = at, _judged(line, at, place)
            sums.add(line, before, at)
        except Refused as exc:
            raise Refused(f"{name}, line {number} ({line.decode('ascii')}): {exc}") from exc
    sums.check_whole(place.printer, name)
    if is_open(job.lines, len(job), place.printer):
        raise Refused(f"{name} ends with the valve open; shut it at its end")
    _check_end(at, place.at, name)
    return tuple(job.lines)


def _judged(line: bytes, at: Modal, place: InsertPlace) -> Modal:
    """Return where the needle is behind a line.

    Raises
    ------
    Refused
    """
    if len(line) + len(b"N9999999 *255\n") > place.printer.max_line_bytes:
        raise Refused("it is too long for the firmware (profile: max_line_bytes)")
    if is_about_valve(line, place.printer):
        return at
    read = read_sent(line)
    if read.code not in _ALLOWED:
        raise Refused(
            f"{read.code} may not be inserted: an insert moves (G0, G1), waits (G4, M400) and "
            "counts the plunger anew (G92 E); heaters, motors, heads and settings are the job's"
        )
    if read.code == "G4":
        _check_wait(read)
    elif read.code == "G92":
        return _counted(read, at)
    elif read.code in _MOVES:
        return _moved(read, at, place)
    return at


def _check_wait(read: GcodeLine) -> None:
    seconds = (read.number("P") or 0.0) / 1e3 + (read.number("S") or 0.0)
    if seconds > LONGEST_WAIT_S:
        raise Refused(f"a wait of {seconds:g} s; at most {LONGEST_WAIT_S:g} s in an insert")


def _counted(read: GcodeLine, at: Modal) -> Modal:
    if set(read.words) != {"E"} or read.number("E") is None:
        raise Refused("an insert may count the plunger anew (G92 E), and no other axis")
    return replace(at, e=read.number("E"))


def _moved(read: GcodeLine, at: Modal, place: InsertPlace) -> Modal:
    words = {axis: read.number(axis) for axis in "XYZEF" if axis in read.words}
    if None in words.values():
        raise Refused("an axis without a number")
    to = replace(at, **{axis.lower(): value for axis, value in words.items()})
    if "E" in words and place.printer.pneumatic is not None:
        raise Refused(f"{place.printer.name} has a valve and no plunger")
    if "E" in words and at.e is None:
        raise Refused("the plunger's count isn't known there; count it first (G92 E)")
    if to.f is None:
        raise Refused("no speed is given (F)")
    _check_room(at, to, place)
    _check_speeds(at, to, place)
    return to


def _check_room(at: Modal, to: Modal, place: InsertPlace) -> None:
    """Refuse a move beyond the machine or the space that the job keeps to."""
    printer, reach = place.printer, place.reach
    begin, end = _counted_from_touch_off(at, place), _counted_from_touch_off(to, place)
    for axis, was, mm in zip(_AXES, begin, end, strict=True):
        span = getattr(printer, f"{axis}_mm")
        if mm != was and not span.low - _TINY <= mm <= span.high + _TINY:
            raise Refused(
                f"{axis.upper()} {mm:.3f} mm is outside {span.low:g} to {span.high:g} mm "
                f"({axis}_mm of {printer.name})"
            )
    held = _counted_from_touch_off(place.at, place)
    if end[2] < min(reach.low_mm, held[2]) - _SAME_MM:
        raise Refused(
            f"Z {end[2]:g} mm is below {reach.low_mm:g} mm, the least height of the job's own moves"
        )
    low = min(begin[2], end[2]) + _SAME_MM
    if begin[:2] != end[:2] and not reach.is_inside(end[0], end[1], low):
        where = f"below Z {reach.top_mm:g} mm " if low < reach.top_mm else ""
        raise Refused(
            f"X {end[0]:g} Y {end[1]:g} is more than {ASIDE_MM:g} mm beside all of the job's own "
            f"moves {where}and the needle's shaft isn't known to be clear there"
        )


def _counted_from_touch_off(at: Modal, place: InsertPlace) -> tuple[float, float, float]:
    x, y, z = (_of(at, axis) - shift for axis, shift in zip(_AXES, place.shift_mm, strict=True))
    return x, y, z


def _check_speeds(at: Modal, to: Modal, place: InsertPlace) -> None:
    """Refuse a move that an axis or the ink doesn't bear."""
    printer, feed = place.printer, (to.f or 0.0) / 60
    steps = {axis: abs(_of(to, axis) - _of(at, axis)) for axis in _AXES}
    push = abs((to.e or 0.0) - (at.e or 0.0)) if to.e is not None and at.e is not None else 0.0
    travel = min(_LONGEST_PUSH_MM, printer.plunger_travel_mm or math.inf)
    if push > travel:
        raise Refused(f"the plunger would go {push:g} mm in one move; at most {travel:g} mm")
    length = math.hypot(*steps.values())
    share = length or push
    limits = {axis: getattr(printer.max_speed_mm_s, axis) for axis in _AXES}
    own = max(place.plunger_mm_s, place.reach.push_mm_s)  # the job's checks took its own pushes
    limits["e"] = min(printer.max_speed_mm_s.e, own)
    for axis, mm in {**steps, "e": push}.items():
        speed = feed * mm / share if share else 0.0
        if speed > limits[axis] * (1 + 1e-6):
            source = "max_speed_mm_s of the printer, plunger_ul_s of the ink, the job's own"
            raise Refused(
                f"{speed:g} mm/s of {axis.upper()} exceeds {limits[axis]:g} ({source}); lower F"
            )


def _check_end(at: Modal, begin: Modal, name: str) -> None:
    """Refuse an insert behind which the job's next line would mean something else."""
    for axis in "xyzef":
        was, now = getattr(begin, axis), getattr(at, axis)
        within = _SAME_E_MM if axis == "e" else _SAME_MM
        if was is None or (now is not None and abs(now - was) <= within):
            continue
        remedy = {
            "e": f"end it with G92 E{was:.5f}",
            "f": f"end it with G1 F{was:g}",
        }.get(axis, f"go back to {axis.upper()}{was:g} at its end")
        raise Refused(
            f"{name} ends at {axis.upper()}{now:g} and the job goes on from {axis.upper()}{was:g}: "
            + remedy
        )


def _of(at: Modal, axis: str) -> float:
    value = getattr(at, axis)
    return math.nan if value is None else float(value)
