"""Start a job's print, its observer, on a station or by itself."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from firmware_profiles import Syringe, load
from printctl.checks.set_up import SetUp
from printctl.machine.link.care import Care
from printctl.machine.link.client import PrintClient
from printctl.machine.link.errors import NoLink
from printctl.machine.printing import Order, retreat_for, usable_mm
from printctl.machine.printing.find import running
from printctl.machine.station import Station, StationState, StationStatus, attach
from printctl.machine.station.status import NO_PRINTER
from printctl.observe.order import ObserverOrder
from printctl.observe.records import ORDER
from printctl.observe.starting import end_idle_observer, start_observer
from printctl.web.errors import ConflictError
from printctl.web.job.jobs import recipe_of
from printctl.web.job.machine import PARTS, Machine
from printctl.web.job.preflight import Preflight
from printctl.web.job.set_up import JobSetUp
from printctl.web.job.set_ups import go_to

# Prepare a run's inspection for a print from the Job page; start its observer.


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


# Job page's access to the printer through the station: print, move, heat.


class StationPrinting:
    """What the job's room asks of the printer.

    Parameters
    ----------
    folder : Path
        The station's.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def machine(self) -> Machine | None:
        """The printer that is connected."""
        status = self._status()
        if status is None or status.state in (StationState.CLOSED, StationState.LOST):
            return None
        mounted = status.mounted
        depth = None
        if mounted.bath_level_mm is not None and mounted.floor_mm is not None:
            depth = mounted.bath_level_mm - mounted.floor_mm
        return Machine(
            profile=status.profile,
            port=status.port,
            ready=status.state is StationState.READY,
            state=status.state.value,
            message=f"{status.state.value}: {status.message}",
            tip_mm=status.position_mm if status.position_trusted else None,
            mounted={thing: getattr(mounted, thing) for thing in PARTS},
            dish_centre_mm=mounted.dish_centre_mm,
            bath_depth_mm=depth,
            ul_left=status.ul_left,
            touch_off_due=status.mounted.touch_off_due,
        )

    def start(self, order: Order) -> PrintClient:
        """Print on the station's port, or attach to the order's print if it is going on.

        Raises
        ------
        ConflictError, LinkError, PrintctlError
        """
        client = running(order)
        return client if client is not None else self._station().print(order)

    def to_start(self, start_mm: tuple[float, float, float]) -> None:
        """Bring the tip to a job's start; see `go_to` for what is raised."""
        go_to(self._station(), start_mm)

    def heat(self, name: str, celsius: float) -> None:
        """Set a heater's target."""
        self._station().heat(name, celsius)

    def temperatures(self) -> dict[str, tuple[float, float | None]]:
        """What each heater has and is to have, °C."""
        status = self._status()
        if status is None or not status.open:
            return {}
        return {one.name: (one.now_c, one.target_c) for one in status.temperatures}

    def _status(self) -> StationStatus | None:
        try:
            return attach(self._folder).status
        except NoLink:
            return None

    def _station(self) -> Station:
        try:
            return attach(self._folder)
        except NoLink as exc:
            raise ConflictError(NO_PRINTER) from exc
