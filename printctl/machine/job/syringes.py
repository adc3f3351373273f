"""Plan syringe changes for a job that needs more ink than one syringe holds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from firmware_profiles import Printer, Syringe
from printctl.checks.set_up import Check
from printctl.machine.errors import LinkError
from printctl.machine.job.job import Job
from printctl.machine.job.reloading import plan_head_reloads, plan_reloads

_ABOUT_THE_SYRINGE = ("plunger travel", "ink, with")
"""How the names of the checks begin that a change of syringe satisfies."""


def capacity_mm(syringe: Syringe) -> float:
    """Plunger travel of a full syringe, but for its dead volume, mm."""
    return (syringe.volume_ul - syringe.dead_volume_ul) * 4 / (math.pi * syringe.inner_mm**2)


def usable_mm(syringe: Syringe, printer: Printer) -> float:
    """Plunger travel that the syringe and the printer's drive both have, mm.

    The syringe's own where no drive pushes it (a pneumatic head).
    """
    return min(capacity_mm(syringe), printer.plunger_travel_mm or math.inf)


def with_reloads(
    checks: list[Check], job: Job, usable: float, *, wanted: bool, by: str = "give --reload"
) -> tuple[list[Check], tuple[int, ...]]:
    """Plan changes of syringe where the checks say that one isn't enough.

    Parameters
    ----------
    checks : list of Check
    job : Job
    usable : float, mm
        Plunger travel of a full syringe.
    wanted : bool
        Whether the user agrees to changes; else the remedy offers them.
    by : str
        How the user agrees, for the remedy.

    Returns
    -------
    checks : list of Check
        With those passed that the changes satisfy, or with the offer in their remedies.
    reload_at : tuple of int
        Command lines before each change.
    """
    short = [check for check in checks if not check.passed and _is_about_it(check)]
    if not short:
        return checks, ()
    try:
        reload_at = plan_reloads(job, usable)
    except LinkError as exc:
        return [_with_remedy(check, f"{check.remedy}; {exc}", short) for check in checks], ()
    if wanted:
        passed = [replace(check, passed=True) if check in short else check for check in checks]
        return passed, reload_at
    lines = ", ".join(str(job.file_line(index + 1)) for index in reload_at)
    offer = f"or {by}: the syringe is then changed before line {lines}"
    return [_with_remedy(check, f"{check.remedy}, {offer}", short) for check in checks], ()


def with_reloads_of(
    checks: list[Check],
    job: Job,
    usable: Sequence[float],
    *,
    wanted: bool,
    by: str = "give --reload",
) -> tuple[list[Check], tuple[int, ...], tuple[int, ...]]:
    """`with_reloads` for one head or several; the third result says whose syringe each change is.

    Parameters
    ----------
    checks : list of Check
    job : Job
    usable : sequence of float, mm
        Plunger travel of a full syringe of each head.
    wanted, by
        As of `with_reloads`.
    """
    if len(usable) == 1:
        return *with_reloads(checks, job, usable[0], wanted=wanted, by=by), ()
    short = [check for check in checks if not check.passed and _is_about_it(check)]
    if not short:
        return checks, (), ()
    try:
        at, heads = plan_head_reloads(job, usable)
    except LinkError as exc:
        return [_with_remedy(check, f"{check.remedy}; {exc}", short) for check in checks], (), ()
    if wanted:
        passed = [replace(check, passed=True) if check in short else check for check in checks]
        return passed, at, heads
    lines = ", ".join(
        f"{job.file_line(index + 1)} (head {head})" for index, head in zip(at, heads, strict=True)
    )
    offer = f"or {by}: the syringe is then changed before line {lines}"
    return [_with_remedy(check, f"{check.remedy}, {offer}", short) for check in checks], (), ()


def _is_about_it(check: Check) -> bool:
    name = check.check.partition(": ")[2] if check.check.startswith("head ") else check.check
    return name.startswith(_ABOUT_THE_SYRINGE)


def _with_remedy(check: Check, remedy: str, short: list[Check]) -> Check:
    return replace(check, remedy=remedy) if check in short else check
