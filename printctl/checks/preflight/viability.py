"""Check the print time against the lifetime of the ink's cells.

The dry run's time runs from the first byte to the last; mixing and filling before it, and what the
cells bear in the bath afterwards, aren't in it. How long cells have is never guessed: the ink's
profile or the recipe says it, with a source, or it is told as unknown.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from printctl.checks.set_up import Budget, Check


@dataclass(frozen=True)
class PrintTime:
    """Print time of a job, with its syringe changes.

    Attributes
    ----------
    duration_s : float, s
        Of the dry run.
    reloads : int
        Changes of syringe.
    reload_min : float or None, min
        Of each; None where nobody said it.
    """

    duration_s: float
    reloads: int = 0
    reload_min: float | None = None

    @property
    def minutes(self) -> float:
        """With the changes, as far as their time is known."""
        return self.duration_s / 60 + self.reloads * (self.reload_min or 0.0)

    @property
    def lacks_reloads(self) -> bool:
        """Whether changes of unknown length are to be added."""
        return self.reloads > 0 and self.reload_min is None


def viability_checks(time: PrintTime, budget: Budget | None) -> list[Check]:
    """Print time within the budget; none where no budget is known."""
    if budget is None:
        return []
    changes = f" with {time.reloads} changes of syringe" if time.reloads else ""
    checks = [
        Check(
            f"print time{changes}, of what the cells have",
            time.minutes,
            budget.minutes,
            "min",
            time.minutes <= budget.minutes,
            f"{budget.key} ({budget.source})",
            "the cells in the syringe would have died; print a smaller part or faster, with a "
            "wider needle and thicker layers, or with ink that is mixed later",
            "refuses" if budget.refuses else "warns",
        )
    ]
    if time.lacks_reloads:
        checks.append(
            Check(
                "time of the changes of syringe",
                0,
                0,
                "",
                False,
                "printer.care.reload_min",
                f"not known, so {time.reloads} changes aren't in the print time; say how long one "
                "takes you",
                "warns",
            )
        )
    return checks


def viability_facts(time: PrintTime, budget: Budget | None) -> dict[str, Any]:
    """For the report: the time and what it is held against, or that nobody knows."""
    available = (
        "not known: neither the ink (viability_min) nor the recipe says it"
        if budget is None
        else f"{budget.minutes:g} min ({budget.source})"
    )
    return {
        "print_time_s": 60 * time.minutes,
        "changes_of_syringe": time.reloads,
        "time_the_cells_have": available,
        **({"changes_timed": False} if time.lacks_reloads else {}),
    }
