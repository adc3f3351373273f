"""At which reload points a job must get a new syringe."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from printctl.link.errors import LinkError
from printctl.link.job import Job
from printctl.link.marks import MarkKind

_PLUNGER: Final = re.compile(rb"(G0*[0123]|G92)(?!\d|\.)[^;]*?E([+-]?\d*\.?\d+)")

_ROUNDING_MM: Final = 1e-4
"""Of E in the text; 2 nL in a syringe of 1 mL."""


def plunger_travel(lines: Sequence[bytes]) -> list[float]:
    """Plunger after each of the first 0, 1, ... lines, mm from the job's begin; (n + 1) values.

    ``G92 E`` changes the count, not the plunger.
    """
    at, shift, travel = 0.0, 0.0, [0.0]
    for line in lines:
        found = _PLUNGER.match(line)
        if found:
            value = float(found[2])
            if found[1] == b"G92":
                shift = at - value
            at = value + shift
        travel.append(at)
    return travel


def plan_reloads(
    job: Job, capacity_mm: float, used_mm: float = 0.0, begin: int = 0
) -> tuple[int, ...]:
    """Choose the fewest reload points, each as late as the syringe lasts.

    Parameters
    ----------
    job : Job
    capacity_mm : float, mm
        Plunger travel of a full syringe.
    used_mm : float, mm
        Of the one in use, travel that is used up at ``begin``.
    begin : int
        Command lines that are done.

    Returns
    -------
    tuple of int
        Command lines before each; empty when one syringe lasts to the end.

    Raises
    ------
    LinkError
        When the stretch between two reload points needs more than a syringe holds.
    """
    travel = plunger_travel(job.lines)
    points = [mark.index for mark in job.marks.of(MarkKind.RELOAD) if mark.index > begin]
    stops = [*points, len(job)]
    chosen: list[int] = []
    start, last, left, peak = begin, begin, capacity_mm - used_mm, travel[begin]
    for stop in stops:
        here = max(travel[last : stop + 1])
        peak = max(peak, here)
        if peak - travel[start] > left + _ROUNDING_MM and last > start:
            chosen.append(last)
            start, left, peak = last, capacity_mm, here
        if peak - travel[start] > left + _ROUNDING_MM:
            raise LinkError(
                f"lines {job.file_line(start + 1)} to {job.file_line(stop)} of {job.name} push the "
                f"plunger by {peak - travel[start]:.2f} mm, and the syringe has {left:.2f} mm left "
                "there; no reload point lies between: use a larger syringe or a smaller part"
            )
        last = stop
    return tuple(chosen)
