"""Printer of the Job page: its state, move to a job's start, heaters; through the station."""

from __future__ import annotations

import math
from dataclasses import field
from pathlib import Path
from typing import Any

from pydantic import computed_field
from pydantic.dataclasses import dataclass

from firmware_profiles import Dish, load
from printctl.checks.gate import RIM_MARGIN_MM, STEP_DOWN_MM
from printctl.checks.set_up import NONE
from printctl.errors import SafetyError
from printctl.machine.control.idle.station_status import (
    NO_PRINTER,
    StationState,
    StationStatus,
    unknown_values,
)
from printctl.machine.errors import NoLink
from printctl.machine.ports.detection import SIMULATED
from printctl.machine.prints.mounted import There
from printctl.machine.process.clients.client import PrintClient, Station, attach_station
from printctl.machine.process.orders import Order
from printctl.web.errors import ConflictError
from printctl.web.job.set_up import JobSetUp, Place
from printctl.web.profile_store import PARTS, ProfileStore


@dataclass(frozen=True)
class Machine:
    """Connected printer with its mounted parts.

    ``ready`` is whether it would take a print now. ``tip_mm`` is None where nobody knows;
    ``mounted`` names profiles of `PARTS`, empty for nothing there, or nobody said; ``ul_left`` is
    in the syringe, but for its dead volume; ``unknown`` has the reasons of `unknown_values`.
    """

    profile: str
    port: str
    ready: bool = True
    state: str = "ready"
    message: str = ""
    tip_mm: tuple[float, float, float] | None = None
    mounted: dict[str, str] = field(default_factory=dict)
    dish_centre_mm: tuple[float, float] | None = None
    bath_depth_mm: float | None = None
    ul_left: float | None = None
    touch_off_due: bool = False
    unknown: dict[str, str] = field(default_factory=dict)

    @computed_field  # type: ignore[prop-decorator]
    @property
    def words(self) -> str:
        """What a person confirms before it moves."""
        return f"{Path(self.profile).stem} on {self.port}"

    @computed_field  # type: ignore[prop-decorator]
    @property
    def simulated(self) -> bool:
        """Whether it is no machine, so that there is nothing to look at."""
        return self.port == SIMULATED

    @property
    def there(self) -> There:
        """What was entered of it."""
        return There(self.profile, self.mounted, self.ul_left)

    @property
    def profiles(self) -> tuple[str, ...]:
        """Profiles that the station itself uses."""
        return self.profile, *self.mounted.values()


class StationPrinting:
    """The printer of a station, which lies in ``folder``."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def machine(self) -> Machine | None:
        """The printer that is connected."""
        status = self._status()
        if status is None or status.state in (StationState.CLOSED, StationState.LOST):
            return None
        mounted = status.mounted
        return Machine(
            profile=status.profile,
            port=status.port,
            ready=status.state is StationState.READY,
            state=status.state.value,
            message=f"{status.state.value}: {status.message}",
            tip_mm=status.position_mm if status.position_trusted else None,
            mounted={part: getattr(mounted, part) for part in PARTS},
            dish_centre_mm=mounted.dish_centre_mm,
            bath_depth_mm=mounted.depth_mm,
            ul_left=status.ul_left,
            touch_off_due=mounted.touch_off_due,
            unknown=unknown_values(status),
        )

    def start(self, order: Order) -> PrintClient:
        """Print on the station's port."""
        return self._station().print(order)

    def to_start(self, start_mm: Place) -> None:
        """Bring the tip to a job's start; the station refuses what its soft limits forbid.

        SafetyError when nobody knows where the tip stands, or how high the dish's floor is;
        LinkError for what the station refuses: the tip then stands where the way so far has led.
        """
        station = self._station()
        status = station.status
        if status.position_mm is None or not status.position_trusted:
            raise SafetyError(
                "nobody knows where the tip stands; home it without the needle, or say where it is "
                "(Printer page), then it can be moved to the start"
            )
        over_mm, mounted = None, status.mounted
        away_mm = math.dist(status.position_mm, start_mm)
        if mounted.touch_off_due and away_mm > STEP_DOWN_MM:
            raise SafetyError(
                f"the floor of {ProfileStore.name(mounted.dish)} isn't touched off with the needle "
                "mounted, so nobody knows how high the tip clears the rim; nothing was moved. "
                "Touch off the floor (Printer page, Touch off), then move the tip to the start"
            )
        if mounted.dish and mounted.floor_mm is not None:
            over_mm = mounted.floor_mm + load(Dish, mounted.dish).wall_mm + RIM_MARGIN_MM
        for x, y, z in places_to(status.position_mm, start_mm, over_mm):
            station.move_to(x, y, z)

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
            return attach_station(self._folder).status
        except NoLink:
            return None

    def _station(self) -> Station:
        try:
            return attach_station(self._folder)
        except NoLink as exc:
            raise ConflictError(NO_PRINTER) from exc


def places_to(tip: Place, start: Place, over_mm: float | None) -> list[Place]:
    """The places that a tip goes to, one after the other: up, across, down to the start, mm.

    ``over_mm`` is the height at which it clears the dish's rim; None where no dish is known.
    """
    high = max(tip[2], start[2], *(() if over_mm is None else (over_mm,)))
    return [(tip[0], tip[1], high), (start[0], start[1], high), start]


def set_up_of(
    machine: Machine | None, before: JobSetUp, declared: Place | None = None, kept: bool = False
) -> JobSetUp:
    """Return a set-up with what is measured at the printer, and with what is mounted.

    Where the job declares its start, the tip must come there; else it starts where the tip stands.
    A set-up that a person ``kept`` goes on naming its printer and parts: where others are there,
    a start is refused (`machine_refusals`), and a person chooses.
    """
    start_mm = declared or (machine.tip_mm if machine else None)
    values: dict[str, Any] = before.model_dump() | ({"start_mm": start_mm} if start_mm else {})
    if machine is not None:
        there = {part: name for part, name in machine.mounted.items() if name}
        there["printer"] = machine.profile
        values |= {one: name for one, name in there.items() if not (kept and values[one])}
        if machine.dish_centre_mm is not None and values["dish"] not in ("", NONE):
            values["dish_centre_mm"] = machine.dish_centre_mm
        if (machine.bath_depth_mm or 0.0) > 0 and values["dish"] not in ("", NONE):
            values["bath_depth_mm"] = machine.bath_depth_mm
    return JobSetUp.model_validate(values)
