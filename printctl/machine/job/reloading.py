"""Plan a job's syringe changes: the fewest reload points, each as late as a syringe lasts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from printctl.machine.errors import LinkError
from printctl.machine.job.heads import head_chosen
from printctl.machine.job.job import Job
from printctl.machine.job.marks import MarkKind
from sim.gcode.reading import code_of, plunger_word

_ROUNDING_MM: Final = 1e-4
"""Of E in the text; 2 nL in a syringe of 1 mL."""


def plunger_travel(lines: Sequence[bytes], head: int | None = None) -> list[float]:
    """Plunger after each of the first 0, 1, ... lines, mm from the job's begin; (n + 1) values.

    ``G92 E`` changes the count, not the plunger. Of several heads (``head`` given) one's alone.
    """
    if head is not None:
        return _of_head(lines, head)
    at, shift, travel = 0.0, 0.0, [0.0]
    for line in lines:
        value = plunger_word(line)
        if value is not None:
            if code_of(line) == b"G92":
                shift = at - value
            at = value + shift
        travel.append(at)
    return travel


def _of_head(lines: Sequence[bytes], head: int) -> list[float]:
    """One head's; E goes on counting over changes of head, and moves another plunger."""
    count, at, chosen, travel = 0.0, 0.0, 0, [0.0]
    for line in lines:
        number = head_chosen(line)
        chosen = chosen if number is None else number
        value = plunger_word(line)
        if value is not None:
            if code_of(line) != b"G92" and chosen == head:
                at += value - count
            count = value
        travel.append(at)
    return travel


def plan_head_reloads(
    job: Job,
    capacity_mm: Sequence[float],
    used_mm: Sequence[float] | None = None,
    begin: int = 0,
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """`plan_reloads` for each of several heads; where, and whose syringe, in the job's order.

    No two at the same point: a person changes one syringe at a time.
    """
    head_of: dict[int, int] = {}
    used = used_mm or [0.0] * len(capacity_mm)
    for head, (capacity, so_far) in enumerate(zip(capacity_mm, used, strict=True)):
        if capacity > 0:
            at = plan_reloads(job, capacity, so_far, begin, head=head, taken=tuple(head_of))
            head_of |= dict.fromkeys(at, head)
    order = sorted(head_of)
    return tuple(order), tuple(head_of[index] for index in order)


def plan_reloads(
    job: Job,
    capacity_mm: float,
    used_mm: float = 0.0,
    begin: int = 0,
    *,
    head: int | None = None,
    taken: Sequence[int] = (),
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
    head : int, optional
        Of several heads, whose.
    taken : sequence of int
        Points that another head's change has.

    Returns
    -------
    tuple of int
        Command lines before each; empty when one syringe lasts to the end.

    Raises
    ------
    LinkError
        When the stretch between two reload points needs more than a syringe holds.
    """
    travel = plunger_travel(job.lines, head)
    marks = {mark.index for mark in job.marks.of(MarkKind.RELOAD) if mark.index > begin}
    points = sorted(marks.difference(taken))
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
