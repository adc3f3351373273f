"""Count the plunger travel that a print has used since the last syringe change."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from printctl.machine.errors import JournalError
from printctl.machine.job.job import Job
from printctl.machine.job.syringes import plunger_travel
from printctl.machine.records.journal import read_records
from printctl.machine.records.record import JOURNAL


@dataclass(frozen=True)
class PlungerState:
    """Plunger state after a print.

    Attributes
    ----------
    plunger_mm : float or None, mm
        Travel of the syringe in use that is used up; None where it wasn't known before.
    wrote : bool
        Whether anything was pushed out.
    """

    plunger_mm: float | None
    wrote: bool


def pushed_mm(job: Job, folder: Path, done: int, before_mm: float | None) -> PlungerState:
    """Count the plunger's travel over the lines done, from the last change of syringe on.

    The relief of a controlled stop isn't taken off: what is left is at least so much.

    Parameters
    ----------
    job : Job
    folder : Path
        The print's, whose journal tells of changes of syringe.
    done : int
    before_mm : float or None, mm
    """
    travel = plunger_travel(job.lines[:done])
    wrote = max(travel) > 0 or any(line.startswith(b"M106") for line in job.lines[:done])
    changed = _last_change(folder)
    if changed is not None:
        at, used = changed
        return PlungerState(used + travel[-1] - travel[min(at, done)], wrote)
    return PlungerState(None if before_mm is None else before_mm + travel[-1], wrote)


def _last_change(folder: Path) -> tuple[int, float] | None:
    """Lines before the last change of syringe of the print, and what was used up of the new one."""
    last: tuple[int, float] | None = None
    try:
        for record in read_records(folder / JOURNAL):
            if record and record.get("t") == "syringe":
                last = int(record["done"]), float(record["plunger_mm"])
    except (OSError, JournalError):
        return None
    return last
