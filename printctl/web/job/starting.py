"""Build a job's print order; refuse a start without operator, ticked checklist, confirmation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from printctl.checks.set_up import SetUp
from printctl.machine.printing import Order, retreat_for
from printctl.observe.order import ObserverOrder
from printctl.web.errors import ConflictError
from printctl.web.job.machine import Machine
from printctl.web.job.observing import with_looks
from printctl.web.job.preflight import Preflight
from printctl.web.job.record import PrintRecord
from printctl.web.job.set_up import JobSetUp
from printctl.web.job.steps_after import checklist

_LIFT_MM = 20.0


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

    Parameters
    ----------
    job, folder : Path
        G-code file, and where the journal goes.
    set_up : JobSetUp
    mounted : SetUp
        Of ``said``.
    machine : Machine
    preflight : Preflight
        Where syringes must be changed, and what failed and was accepted.
    observer : ObserverOrder, optional
    """
    loads = [mounted.load_of(k) for k in range(mounted.printer.head_count)]
    prime = set_up.care.prime_ul
    retreat, *others = (retreat_for(one.syringe, one.ink, _LIFT_MM, prime) for one in loads)
    care = replace(
        set_up.watched(mounted),
        reload_at=tuple(preflight.facts["reload_at"]),
        reload_heads=tuple(preflight.facts["reload_heads"]),
        accepted=tuple(preflight.facts["accepted"]),
    )
    return Order(
        job,
        machine.profile,
        machine.port,
        folder,
        replace(retreat, others=tuple(others)),
        once=True,
        care=with_looks(care, observer),
    )


def refuse_unconfirmed(machine: Machine, record: PrintRecord, confirmed: str) -> None:
    """Refuse a start that nobody has thought through.

    Raises
    ------
    ConflictError
        Without the operator's name, with points of the list open, or without the machine's name.
    """
    if not record.operator.strip():
        raise ConflictError("the record doesn't say who prints; fill in the operator's name")
    open_points = [
        point["text"] for point in checklist()["before"] if not record.ticked.get(point["id"])
    ]
    if open_points:
        raise ConflictError(
            f"{len(open_points)} points of the list before the start aren't ticked; the first: "
            f"{open_points[0]}"
        )
    if confirmed != machine.words:
        raise ConflictError(
            f"the start is confirmed for {confirmed[:120] or 'no machine'!r}, and connected is "
            f"{machine.words!r}; confirm that one"
        )
