"""Plan syringe changes: plunger travel, fewest reload points, checks, and plans with inserts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from firmware_profiles import Printer, Syringe
from gcode.reading import code_of, plunger_word
from printctl.checks.kinds import Kind
from printctl.checks.set_up import Check
from printctl.machine.errors import LinkError, Refused
from printctl.machine.job.dispensing import head_chosen
from printctl.machine.job.job import Job
from printctl.machine.job.marks import MarkKind, behind

_ROUNDING_MM: Final = 1e-4
"""Of E in the text; 2 nL in a syringe of 1 mL."""
OF_THE_SYRINGE: Final = (Kind.PLUNGER_TRAVEL, Kind.SYRINGE_VOLUME)
"""Checks that a change of syringe satisfies."""
Plan = tuple[tuple[int, ...], tuple[int, ...]]
"""Reload points, by the lines before each; and whose syringe, of several heads."""


def capacity_mm(syringe: Syringe) -> float:
    """Return the plunger travel of a full syringe, but for its dead volume, mm."""
    return (syringe.volume_ul - syringe.dead_volume_ul) * 4 / (math.pi * syringe.inner_mm**2)


def usable_mm(syringe: Syringe, printer: Printer) -> float:
    """Return the plunger travel that the syringe and the printer's drive both have, mm.

    The syringe's own where no drive pushes it (a pneumatic head).
    """
    return min(capacity_mm(syringe), printer.plunger_travel_mm or math.inf)


def plunger_travel(lines: Sequence[bytes], head: int | None = None) -> list[float]:
    """Return the plunger's place after the first 0, 1, ... lines, mm from the job's begin.

    ``G92 E`` changes the count, not the plunger. Of several heads (``head`` given) one's alone: E
    goes on counting over changes of head, and moves another plunger.
    """
    at, shift, chosen, travel = 0.0, 0.0, 0, [0.0]
    for line in lines:
        if head is not None and (number := head_chosen(line)) is not None:
            chosen = number
        value = plunger_word(line)
        if value is not None:
            if code_of(line) == b"G92" or (head is not None and chosen != head):
                shift = at - value
            else:
                at = value + shift
        travel.append(at)
    return travel


def plan_head_reloads(
    job: Job, capacity_mm: Sequence[float], used_mm: Sequence[float] | None = None, begin: int = 0
) -> Plan:
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

    A full syringe has ``capacity_mm`` of plunger travel; of the one in use ``used_mm`` are used up
    after ``begin`` command lines. Of several heads it is ``head``'s; ``taken`` are points that
    another head's change has. Returns the command lines before each; none where one syringe lasts.
    Raises `LinkError` where the stretch between two points needs more than a syringe holds.
    """
    travel = plunger_travel(job.lines, head)
    marks = {mark.index for mark in job.marks.of(MarkKind.RELOAD) if mark.index > begin}
    chosen: list[int] = []
    start, last, left, peak = begin, begin, capacity_mm - used_mm, travel[begin]
    for stop in [*sorted(marks.difference(taken)), len(job)]:
        here = max(travel[last : stop + 1])
        peak = max(peak, here)
        if peak - travel[start] > left + _ROUNDING_MM and last > start:
            chosen.append(last)
            start, left, peak = last, capacity_mm, here
        if peak - travel[start] > left + _ROUNDING_MM:
            raise LinkError(
                f"lines {job.file_line(start + 1)} to {job.file_line(stop)} of {job.name} advance "
                f"the plunger by {peak - travel[start]:.2f} mm, but the syringe has {left:.2f} mm "
                "left there, and there is no reload point in between: use a larger syringe or a "
                "smaller part"
            )
        last = stop
    return tuple(chosen)


@dataclass(frozen=True)
class Reloads:
    """Checks of a job with the changes of syringe that it needs.

    Attributes
    ----------
    checks : list of Check
    at, heads : tuple of int
        Command lines before each change; of several heads, whose syringe it is.
    offered : bool
        Whether changes that weren't wanted would do.
    """

    checks: list[Check]
    at: tuple[int, ...] = ()
    heads: tuple[int, ...] = ()
    offered: bool = False


def with_reloads(
    checks: list[Check], job: Job, usable: Sequence[float], *, wanted: bool, by: str
) -> Reloads:
    """Plan changes of syringe where the checks say that one isn't enough.

    A full syringe of each head has ``usable`` mm of plunger travel. Where they are ``wanted``, what
    the changes satisfy passes; else the remedies of such checks offer them, and say ``by`` what the
    user agrees.
    """
    short = [check for check in checks if not check.passed and check.kind in OF_THE_SYRINGE]
    if not short:
        return Reloads(checks)
    at: tuple[int, ...]
    heads: tuple[int, ...] = ()
    try:
        if len(usable) == 1:
            at = plan_reloads(job, usable[0])
        else:
            at, heads = plan_head_reloads(job, usable)
    except LinkError as exc:
        return Reloads(_with_remedies(checks, short, f"; {exc}"))
    if wanted:
        passed = [replace(check, passed=True) if check in short else check for check in checks]
        return Reloads(passed, at, heads)
    whose = [f" (head {head})" for head in heads] or [""] * len(at)
    numbers = (job.file_line(index + 1) for index in at)
    lines = ", ".join(f"{line}{head}" for line, head in zip(numbers, whose, strict=True))
    offer = f", or {by}: the syringe is then changed before line {lines}"
    return Reloads(_with_remedies(checks, short, offer), offered=True)


def _with_remedies(checks: list[Check], short: list[Check], more: str) -> list[Check]:
    return [
        replace(check, remedy=check.remedy + more) if check in short else check for check in checks
    ]


@dataclass(frozen=True)
class Filling:
    """Syringe that was put in last, after ``done`` command lines; ``name`` is its profile's.

    ``used_mm`` of its travel were used up then; a full one has ``capacity_mm``, 0 if unknown.
    """

    done: int = 0
    used_mm: float = 0.0
    capacity_mm: float = 0.0
    name: str = ""


def grown_plan(job: Job, grown: Job, plan: Plan, filling: Filling, head: int | None = None) -> Plan:
    """Plan the changes of syringe anew for a job with an insert.

    ``job`` is without the insert, ``grown`` with it as the last one; ``plan`` is for ``job``.
    ``filling`` is of the head in use: ``head``, of several. Raises `Refused` where the syringe
    doesn't last for the insert, as it did without.
    """
    after, count = grown.positions[-1]
    shifted = tuple(behind(index, after, count) for index in plan[0])
    if not filling.capacity_mm:
        return shifted, plan[1]
    whose: Sequence[int | None] = plan[1] or [None] * len(shifted)
    every = dict(zip(shifted, whose, strict=True))
    own = [at for at, who in every.items() if who == head]
    others = {at: who for at, who in every.items() if who != head and who is not None}
    here = [at for at in own if at == after]  # the insert is written with a new one
    travel = plunger_travel(job.lines[:after], head)
    since = travel[-1] - travel[min(filling.done, after)]
    used = 0.0 if here else filling.used_mm + since
    try:
        before = plan_reloads(job, filling.capacity_mm, used, after, head=head)
    except LinkError:
        before = None
    if before is None or (before and not own):  # printed so all the same, on a person's word
        return shifted, plan[1]
    try:
        points = tuple(others)
        new_plan = plan_reloads(grown, filling.capacity_mm, used, after, head=head, taken=points)
    except LinkError as exc:
        raise Refused(f"the injected G-code needs more ink than is left: {exc}") from exc
    if new_plan and not own:
        raise Refused(
            f"with the injected G-code the syringe, {filling.capacity_mm - used:.2f} mm of plunger "
            "left, doesn't last until the end of the job, and no syringe change is planned: pause "
            "and change it (`printctl reload RUN`), or omit the injected G-code"
        )
    every = {**others, **dict.fromkeys((*here, *new_plan), head)}
    order = sorted(every)
    return tuple(order), tuple(who for index in order if (who := every[index]) is not None)
