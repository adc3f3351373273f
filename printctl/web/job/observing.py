"""Prepare a run's inspection for a print from the Job page; start its observer."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from firmware_profiles import Syringe, load
from printctl.checks.set_up import SetUp
from printctl.machine.link.care import Care
from printctl.machine.printing import Order, usable_mm
from printctl.observe.order import ObserverOrder
from printctl.observe.records import ORDER
from printctl.observe.starting import end_idle_observer, start_observer
from printctl.web.errors import ConflictError
from printctl.web.job.jobs import recipe_of
from printctl.web.job.set_up import JobSetUp


def observer_order(job: Path, set_up: JobSetUp, mounted: SetUp) -> ObserverOrder | None:
    """Return how a job's print is observed, with what is mounted; None where nobody asks for it.

    Parameters
    ----------
    job : Path
        G-code file; a run's recipe may ask for an observer.
    set_up : JobSetUp
    mounted : SetUp
        Of ``said``.

    Raises
    ------
    ConflictError
        When the recipe asks for one, and the run's folder doesn't say how.
    """
    folder = job.parent
    recipe = recipe_of(folder)
    if recipe is None or recipe.observe is None:
        return None
    try:
        order = ObserverOrder.load(folder)
    except (OSError, ValueError) as exc:
        raise ConflictError(
            f"the recipe of {folder.name} has its print observed, and {ORDER} in its folder, which "
            f"says how, can't be read ({exc}): make the run anew (`printctl run RECIPE --until "
            "toolpath`); nothing was moved"
        ) from exc
    syringe = load(Syringe, set_up.syringe)
    return replace(
        order,
        job=str(job.resolve()),
        profile=set_up.printer,
        syringe=set_up.syringe,
        ink=set_up.ink,
        needle=set_up.needle or order.needle,
        capacity_ul=usable_mm(syringe, mounted.printer) * syringe.area_mm2,
    )


def with_looks(care: Care, order: ObserverOrder | None) -> Care:
    """Return how a print is watched over, with the looks that its observer's order says."""
    return care if order is None else Care.from_dict(care.to_dict() | order.care)


@contextmanager
def observer_ready(order: Order, observer: ObserverOrder | None) -> Iterator[None]:
    """Have an observer ready before a print begins, and end it where the print doesn't.

    Raises
    ------
    ObserverError
        When it can't be started; nothing has moved.
    """
    if observer is None:
        yield
        return
    order.folder.mkdir(parents=True, exist_ok=True)
    observer.save(order.folder)
    start_observer(order.folder)
    try:
        yield
    except Exception:
        end_idle_observer(order.folder)
        raise
