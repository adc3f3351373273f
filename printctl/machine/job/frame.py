"""Coordinate frame of a job: the effect of its G92 lines relative to the touch-off point."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from firmware_profiles import Printer
from firmware_profiles.families import family_of
from printctl.machine.errors import LinkError
from printctl.machine.job.job import Job
from printctl.machine.job.modal import ModalTrail, declared_axes
from sim.gcode.reading import code_of, is_motion, read_sent

_AXES: Final = "XYZ"
Place = tuple[float, float, float]
_SAME_MM: Final = 1e-9
"""Rounding of sums of numbers with few decimals."""


@dataclass(frozen=True)
class Renaming:
    """A line that says where the tip stands.

    Attributes
    ----------
    index : int
        Of the command line; -1 for the place that checks took the tip to stand at.
    line : bytes
    declared : dict of str to float
        Axes that nothing before it has told, mm.
    moved : dict of str to float
        By how much it calls other axes' places otherwise, mm; empty where it names the place that
        the job's text says anyway.
    """

    index: int
    line: bytes
    declared: dict[str, float]
    moved: dict[str, float]


@dataclass(frozen=True)
class JobFrame:
    """What a job's lines add to a place, counted from where the tip was touched off.

    Attributes
    ----------
    start : (x, y, z) or None, mm
        Where the first lines, or else the checks, tell that the tip stands; None where the machine
        is homed.
    lines : tuple of bytes
        Commands, without E, that tell ``start``.
    top : float, mm
        Greatest height of any move of the job, as ``start`` counts.
    renamed : tuple of (int, (x, y, z) in mm)
        Command lines that call a place otherwise, and what places are called beyond ``start``'s
        count from there on; in order.
    """

    start: Place | None
    lines: tuple[bytes, ...]
    top: float
    renamed: tuple[tuple[int, Place], ...] = ()

    def shift_at(self, index: int) -> Place:
        """Return what a place is called by command line ``index`` beyond ``start``'s count, mm."""
        before = bisect_right(self.renamed, index, key=lambda one: one[0])
        return self.renamed[before - 1][1] if before else (0.0, 0.0, 0.0)


def renamings(lines: Sequence[bytes]) -> list[Renaming]:
    """Return the lines that say where the tip stands, in order."""
    trail, all_renamings = ModalTrail(lines), list[Renaming]()
    for index, line in enumerate(lines):
        told = declared_axes(line)
        if not told:
            continue
        at = trail.at(index).place()
        before = {axis: at[axis.lower()] for axis in told if axis.lower() in at}
        moved = {axis: told[axis] - mm for axis, mm in before.items()}
        declared = {axis: mm for axis, mm in told.items() if axis not in before}
        changed = {axis: mm for axis, mm in moved.items() if abs(mm) > _SAME_MM}
        all_renamings.append(Renaming(index, line, declared, changed))
    return all_renamings


def frame_at(job: Job, begin: int, printer: Printer, start_mm: Place | None = None) -> JobFrame:
    """Return the frame of a job, and the commands that tell it before command line ``begin``.

    Parameters
    ----------
    job : Job
    begin : int
    printer : Printer
    start_mm : (x, y, z) or None, mm
        Where the checks took the tip to stand before the first line; it counts for a job that tells
        some of X, Y and Z alone, or tells them late.

    Raises
    ------
    LinkError
        Where a line says where the tip stands that nobody can follow.
    """
    named = _named(job, start_mm)
    start, lines = _declared(job, named)
    if start is None:  # what renames places behind ``begin`` stays in the rest
        _shifts(job, [one for one in named if one.index < begin], start)
        return JobFrame(None, lines, _top(job, named))
    frame = JobFrame(start, lines, _top(job, named), _shifts(job, named, start))
    if named[0].index < 0 or any(frame.shift_at(begin - 1)):
        return replace(frame, lines=_telling(start, printer))
    return frame


def _telling(start: Place, printer: Printer) -> tuple[bytes, ...]:
    """Write what tells a printer where the tip stands; where it keeps G92 apart, that as well."""
    declares = family_of(printer).dialect(printer).declares
    x, y, z = (f"{mm:.5f}" for mm in start)
    every = (declares, "G92 X{x} Y{y} Z{z}")
    return tuple(one.format(x=x, y=y, z=z).encode("ascii") for one in every if one)


def _named(job: Job, start_mm: Place | None) -> list[Renaming]:
    """Return the job's renamings, behind the place of its checks where the job needs that."""
    named = renamings(job.lines)
    early = range(_first_move(job))
    told = {axis for one in named if one.index in early for axis in one.declared}
    places = any(one.declared or one.moved for one in named)
    homes = any(code_of(line) == b"G28" for line in job.lines)
    if start_mm is None or homes or told == set(_AXES) or not places:
        return named
    checked = b"G92 X%.5f Y%.5f Z%.5f" % start_mm
    return [replace(one, index=one.index - 1) for one in renamings((checked, *job.lines))]


def _first_move(job: Job) -> int:
    return next((k for k, line in enumerate(job.lines) if is_motion(line)), len(job))


def _declared(job: Job, named: Sequence[Renaming]) -> tuple[Place | None, tuple[bytes, ...]]:
    """Where the tip stands by the lines before the first move, and those lines without E."""
    declaring = [one for one in named if one.declared]
    if not declaring:
        return None, ()
    first, places = _first_move(job), dict[str, float]()
    for one in declaring:
        places |= one.declared
        if one.index > first:
            _refuse(job, one, "tells where the tip stands, behind a move")
    if set(places) != set(_AXES):
        _refuse(job, declaring[-1], "tells where the tip stands, and not in all of X, Y and Z")
    words = (one.line.split(b" ") for one in declaring)
    lines = tuple(b" ".join(word for word in line if word[:1] != b"E") for line in words)
    return (places["X"], places["Y"], places["Z"]), lines


def _shifts(
    job: Job, named: Sequence[Renaming], start: Place | None
) -> tuple[tuple[int, Place], ...]:
    """Add up what lines call a place beyond the count of ``start``, mm."""
    total, shifts = dict.fromkeys(_AXES, 0.0), list[tuple[int, Place]]()
    for one in named:
        if not one.moved:
            continue
        by_name = code_of(one.line) != b"G92"  # leaves what G92 has shifted as it is
        if start is None or (by_name and any(total.values())):
            _refuse(job, one, "calls a place otherwise that no line before the first move tells")
        for axis, mm in one.moved.items():
            total[axis] += mm
        x, y, z = (mm if abs(mm) > _SAME_MM else 0.0 for mm in total.values())
        shifts.append((one.index, (x, y, z)))
    return tuple(shifts)


def _top(job: Job, named: Sequence[Renaming]) -> float:
    """Greatest height of the job's moves, mm, by the frame of its first lines."""
    by = {one.index: one.moved.get("Z", 0.0) for one in named}
    shift, heights = 0.0, list[float]()
    for index, line in enumerate(job.lines):
        shift += by.get(index, 0.0)
        if b"Z" in line and is_motion(line):
            z = read_sent(line).number("Z")
            heights += [] if z is None else [z - shift]
    return max(heights, default=-float("inf"))


def _refuse(job: Job, one: Renaming, what: str) -> None:
    text = one.line.decode("ascii")
    raise LinkError(
        f"line {job.file_lines[one.index]} ({text}) {what}: nobody can tell after a loss of "
        "position where the rest of the job belongs; print the part anew, with a job whose first "
        "lines tell X, Y and Z"
    )
