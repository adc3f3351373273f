"""Job page's access to the printer through the station: print, move, heat."""

from __future__ import annotations

from pathlib import Path

from printctl.machine.link.client import PrintClient
from printctl.machine.link.errors import NoLink
from printctl.machine.printing import Order
from printctl.machine.printing.find import running
from printctl.machine.station import Station, StationState, StationStatus, attach
from printctl.machine.station.status import NO_PRINTER
from printctl.web.errors import ConflictError
from printctl.web.job.machine import Machine
from printctl.web.job.to_start import go_to

_THINGS = ("needle", "syringe", "ink", "dish", "bath")


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
            message=f"{status.state.value}: {status.message}",
            tip_mm=status.position_mm if status.position_trusted else None,
            mounted={thing: getattr(mounted, thing) for thing in _THINGS},
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
