"""Changes of syringe that a job needs, and the time that they take from its cells."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from firmware_profiles import Ink
from printctl.checks.preflight.ink import PrintTime, viability_checks, viability_facts
from printctl.checks.set_up import Check, shortest_budget
from printctl.machine.job.job import Job
from printctl.machine.job.syringes import with_reloads
from printctl.recipe.sections.making import CarePart


@dataclass(frozen=True)
class SyringePlan:
    """A job's checks with its changes of syringe.

    Attributes
    ----------
    checks : list of Check
        With the print time's.
    reload_at, reload_heads : tuple of int
        Command lines before each change; of several heads, whose syringe it is.
    facts : dict
        The above but for the checks, and what the cells have.
    """

    checks: list[Check]
    reload_at: tuple[int, ...]
    reload_heads: tuple[int, ...]
    facts: dict[str, Any]


def plan_syringes(
    checks: list[Check],
    job: Job,
    usable_mm: Sequence[float],
    inks: Iterable[Ink],
    duration_s: float,
    care: CarePart,
    by: str = "give --reload",
) -> SyringePlan:
    """Plan the changes of syringe and judge the print time with them.

    ``usable_mm`` is the plunger travel of each head's full syringe; ``by`` as of `with_reloads`.
    """
    planned, at, heads = with_reloads(checks, job, usable_mm, wanted=care.reload, by=by)
    budget = shortest_budget(inks, care.viability_min, care.viability_source)
    time = PrintTime(duration_s, len(at), care.reload_min)
    facts = {
        "reload_at": list(at),
        "reload_heads": list(heads),
        **viability_facts(time, budget),
    }
    return SyringePlan([*planned, *viability_checks(time, budget)], at, heads, facts)
