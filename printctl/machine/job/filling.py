"""Data class of the syringe in use; replan syringe changes for a job with inserted lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from printctl.machine.errors import LinkError, Refused
from printctl.machine.job.inserts import behind
from printctl.machine.job.job import Job
from printctl.machine.job.reloading import plan_reloads, plunger_travel

Plan = tuple[tuple[int, ...], tuple[int, ...]]
"""Reload points, by the lines before each; and whose syringe, of several heads."""


@dataclass(frozen=True)
class Filling:
    """What was put in last.

    Attributes
    ----------
    done : int
        Command lines taken before.
    used_mm : float, mm
        Travel used up of it then.
    capacity_mm : float, mm
        Travel of a full one; 0 where unknown.
    name : str
        Its profile; empty where unknown.
    """

    done: int = 0
    used_mm: float = 0.0
    capacity_mm: float = 0.0
    name: str = ""


def grown_plan(job: Job, grown: Job, plan: Plan, filling: Filling, head: int | None = None) -> Plan:
    """Plan the changes of syringe anew for a job with an insert.

    Parameters
    ----------
    job, grown : Job
        Without the insert, and with it as the last one.
    plan : Plan
        As it stands, for the job without the insert.
    filling : Filling
        Of the head in use.
    head : int, optional
        That head, of several.

    Raises
    ------
    Refused
        Where the syringe doesn't last for the insert, as it did without.
    """
    after, count = grown.positions[-1]
    shifted = tuple(behind(index, after, count) for index in plan[0])
    if not filling.capacity_mm:
        return shifted, plan[1]
    whose: Sequence[int | None] = plan[1] or [None] * len(shifted)
    own = tuple(at for at, who in zip(shifted, whose, strict=True) if who == head)
    others = {
        at: who for at, who in zip(shifted, whose, strict=True) if who != head and who is not None
    }
    here = tuple(at for at in own if at == after)  # the insert is written with a new one
    used = 0.0 if here else filling.used_mm + _travel(job, filling.done, after, head)
    asked = filling.capacity_mm, used, after
    before = _planned(job, *asked, head, ())
    if before is None or (before and not own):  # printed so all the same, on a person's word
        return shifted, plan[1]
    try:
        new_plan = plan_reloads(grown, *asked, head=head, taken=tuple(others))
    except LinkError as exc:
        raise Refused(f"the insert needs more ink than is left: {exc}") from exc
    if new_plan and not own:
        raise Refused(
            f"with the insert the syringe, {filling.capacity_mm - used:.2f} mm of plunger left, "
            "doesn't last to the job's end, and no change of it is planned: pause and change it "
            "(`printctl reload RUN`), or leave the insert out"
        )
    every: dict[int, int | None] = {**others, **dict.fromkeys((*here, *new_plan), head)}
    order = sorted(every)
    heads = tuple(who for index in order if (who := every[index]) is not None)
    return tuple(order), heads


def _travel(job: Job, begin: int, end: int, head: int | None) -> float:
    travel = plunger_travel(job.lines[:end], head)
    return travel[-1] - travel[min(begin, end)]


def _planned(
    job: Job, capacity: float, used: float, begin: int, head: int | None, taken: tuple[int, ...]
) -> tuple[int, ...] | None:
    try:
        return plan_reloads(job, capacity, used, begin, head=head, taken=taken)
    except LinkError:
        return None
