"""Order of a job's print from the page, and its observer."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Final

from firmware_profiles import Syringe, load
from printctl.checks.set_up import SetUp, of_each
from printctl.machine.link.care import Care
from printctl.machine.printing import Order, retreat_for, usable_mm
from printctl.observe.order import ObserverOrder
from printctl.observe.records import ORDER
from printctl.observe.starting import end_idle_observer, start_observer
from printctl.web.errors import ConflictError
from printctl.web.job.machine import Machine
from printctl.web.job.preflight import Preflight
from printctl.web.job.set_up import JobSetUp, recipe_of

_LIFT_MM: Final = 20.0


def observer_order(job: Path, set_up: JobSetUp, mounted: SetUp) -> ObserverOrder | None:
    """Return how a job's print is observed, with what is mounted; None where nobody asks for it.

    The recipe of the run that the G-code file is of may ask for an observer; ConflictError when the
    run's folder doesn't say how.
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


@contextmanager
def observer_ready(order: Order, observer: ObserverOrder | None) -> Iterator[None]:
    """Have an observer ready before a print begins, and end it where the print doesn't.

    ObserverError when it can't be started; nothing has moved.
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


def order_of(
    job: Path,
    folder: Path,
    set_up: JobSetUp,
    mounted: SetUp,
    machine: Machine,
    preflight: Preflight,
    observer: ObserverOrder | None = None,
) -> Order:
    """The order, as `printctl print` makes it, with the looks of a run's observer.

    ``mounted`` is what the set-up names; the journal goes into ``folder``; the preflight says where
    syringes must be changed, and what failed and was accepted.
    """
    printer, part = mounted.printer, set_up.care
    loads = [mounted.load_of(k) for k in range(printer.head_count)]
    retreat, *others = (retreat_for(one.syringe, one.ink, _LIFT_MM, part.prime_ul) for one in loads)
    names, usable = of_each(printer, set_up.syringe, "syringe"), set_up.usable_mm(mounted)
    several = len(names) > 1
    care = Care(
        checkpoint_s=part.checkpoint_every_s,
        deadman_s=60.0 * part.deadman_min,
        deadman_stops=part.deadman_stops,
        silent_limit_s=part.silent_limit_s,
        noise_limit=part.noise_limit,
        syringe=names[0],
        capacity_mm=usable[0],
        head_syringes=tuple(names) if several else (),
        head_capacity_mm=tuple(usable) if several else (),
        start_mm=set_up.start_mm,
        reload_at=tuple(preflight.facts["reload_at"]),
        reload_heads=tuple(preflight.facts["reload_heads"]),
        accepted=tuple(preflight.facts["accepted"]),
    )
    if observer is not None:
        care = Care.from_dict(care.to_dict() | observer.care)
    retreat = replace(retreat, others=tuple(others))
    return Order(job, machine.profile, machine.port, folder, retreat, once=True, care=care)
