"""Describe path length and ink of job lines that a resumed print may write twice."""

from __future__ import annotations

import math
from collections.abc import Sequence

from printctl.machine.job.job import Job
from printctl.machine.job.modal import Modal, ModalTrail
from printctl.machine.job.reloading import plunger_travel
from sim.gcode.reading import GcodeLine, is_motion, read_sent


def describe_rewritten_ink(
    job: Job, first: int, last: int, head: int | None = None, ul_per_mm: float | None = None
) -> str:
    """Describe how much ink lines ``first`` to ``last`` - 1 write; empty for none.

    Parameters
    ----------
    job : Job
    first, last : int
    head : int, optional
        Of several, the one in use.
    ul_per_mm : float, µL/mm, optional
        Of the plunger; None where nobody knows the syringe.
    """
    travel = plunger_travel(job.lines, head)
    pushed = max(travel[first : last + 1]) - travel[first]
    path = path_mm(job.lines, first, last, travel)
    if path <= 0 and pushed <= 0:
        return ""
    plunger = f"{pushed:.3f} mm of plunger"
    ink = plunger if ul_per_mm is None else f"{pushed * ul_per_mm:.2f} µL ({plunger})"
    amount = f"{path:.1f} mm of path" + (f" and {ink}" if pushed > 0 else "")
    return f"at most {amount}, lines {job.file_lines[first]} to {job.file_line(last)}"


def path_mm(lines: Sequence[bytes], first: int, last: int, travel: Sequence[float]) -> float:
    """Length of the moves that push the plunger, mm; of all moves where nothing tells of it."""
    trail, total, any_plunger = ModalTrail(lines), 0.0, any(travel)
    for index in range(first, last):
        if is_motion(lines[index]) and (travel[index + 1] > travel[index] or not any_plunger):
            total += _length(trail.at(index), trail.at(index + 1), read_sent(lines[index]))
    return total


def _length(begin: Modal, end: Modal, line: GcodeLine) -> float:
    known = (
        (b, e)
        for b, e in zip((begin.x, begin.y, begin.z), (end.x, end.y, end.z), strict=True)
        if b is not None and e is not None
    )
    arc = _arc_mm(begin, end, line)
    return (
        math.hypot(arc, (end.z or 0) - (begin.z or 0))
        if arc
        else math.hypot(*(e - b for b, e in known))
    )


def _arc_mm(begin: Modal, end: Modal, line: GcodeLine) -> float:
    """Length of an arc in x and y, mm; 0 for a straight move."""
    if line.code not in ("G2", "G3") or None in (begin.x, begin.y, end.x, end.y):
        return 0.0
    dx, dy = (end.x or 0) - (begin.x or 0), (end.y or 0) - (begin.y or 0)
    radius = line.number("R")
    if radius is not None:
        half = math.asin(min(1.0, math.hypot(dx, dy) / (2 * abs(radius))))
        return abs(radius) * 2 * (half if radius > 0 else math.pi - half)
    i, j = line.number("I") or 0.0, line.number("J") or 0.0
    turn = math.atan2(-j, -i) - math.atan2(dy - j, dx - i)
    turn = turn if line.code == "G2" else -turn
    return math.hypot(i, j) * (turn % (2 * math.pi) or 2 * math.pi)
