"""Frame of a job's coordinates: what its lines call the place at which the tip was touched off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from printctl.link.errors import LinkError
from printctl.link.job import Job
from printctl.link.modal import ModalTrail, places_told
from sim.reading import code_of, is_motion, read_sent

_AXES: Final = "XYZ"
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
    """Frame before a line.

    Attributes
    ----------
    start : (x, y, z) or None, mm
        Where the first lines, or else the checks, tell that the tip stands; None where the machine
        is homed.
    shift : (x, y, z), mm
        What later lines have added to what a place is called.
    lines : tuple of bytes
        Commands, without E, that make the frame with the tip at ``start``.
    top : float, mm
        Greatest height of any move of the job, as ``start`` counts.
    """

    start: tuple[float, float, float] | None
    shift: tuple[float, float, float]
    lines: tuple[bytes, ...]
    top: float


def renamings(lines: Sequence[bytes]) -> list[Renaming]:
    """Return the lines that say where the tip stands, in order."""
    trail, found = ModalTrail(lines), list[Renaming]()
    for index, line in enumerate(lines):
        told = places_told(line)
        if not told:
            continue
        at = trail.at(index).place()
        before = {axis: at[axis.lower()] for axis in told if axis.lower() in at}
        moved = {axis: told[axis] - mm for axis, mm in before.items()}
        declared = {axis: mm for axis, mm in told.items() if axis not in before}
        changed = {axis: mm for axis, mm in moved.items() if abs(mm) > _SAME_MM}
        found.append(Renaming(index, line, declared, changed))
    return found


def frame_at(job: Job, begin: int, start_mm: tuple[float, float, float] | None = None) -> JobFrame:
    """Return the frame before command line ``begin``.

    Parameters
    ----------
    job : Job
    begin : int
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
    shift = _shift(job, [one for one in named if one.index < begin], start)
    if any(shift) and start is not None:
        # One G92 tells the place as it is called there: two would be a place told anew.
        renamed = (mm + by for mm, by in zip(start, shift, strict=True))
        others = (line for line in lines if code_of(line) != b"G92")
        lines = (*others, b"G92 X%.5f Y%.5f Z%.5f" % tuple(renamed))
    return JobFrame(start, shift, lines, _top(job, named))


def _named(job: Job, start_mm: tuple[float, float, float] | None) -> list[Renaming]:
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


def _declared(
    job: Job, named: Sequence[Renaming]
) -> tuple[tuple[float, float, float] | None, tuple[bytes, ...]]:
    """Where the tip stands by the lines before the first move, and those lines without E."""
    declaring = [one for one in named if one.declared]
    if not declaring:
        return None, ()
    first, found = _first_move(job), dict[str, float]()
    for one in declaring:
        found |= one.declared
        if one.index > first:
            _refuse(job, one, "tells where the tip stands, behind a move")
    if set(found) != set(_AXES):
        _refuse(job, declaring[-1], "tells where the tip stands, and not in all of X, Y and Z")
    words = (one.line.split(b" ") for one in declaring)
    lines = tuple(b" ".join(word for word in line if word[:1] != b"E") for line in words)
    return (found["X"], found["Y"], found["Z"]), lines


def _shift(
    job: Job, named: Sequence[Renaming], start: tuple[float, float, float] | None
) -> tuple[float, float, float]:
    total = dict.fromkeys(_AXES, 0.0)
    for one in named:
        if one.moved and (start is None or code_of(one.line) != b"G92"):
            _refuse(job, one, "calls a place otherwise that no line before the first move tells")
        for axis, mm in one.moved.items():
            total[axis] += mm
    x, y, z = (mm if abs(mm) > _SAME_MM else 0.0 for mm in total.values())
    return x, y, z


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
