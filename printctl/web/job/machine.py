"""Printer interface of the Job page: mounted items, tip position, print start."""

from __future__ import annotations

from dataclasses import field
from pathlib import Path
from typing import Final, Protocol

from pydantic import computed_field
from pydantic.dataclasses import dataclass

from printctl.machine.link.client import PrintClient
from printctl.machine.printing import Order
from printctl.machine.printing.simulated import SIMULATED
from printctl.web.job.set_up import JobSetUp

PARTS: Final = ("needle", "syringe", "ink", "bath", "dish")
"""What can be mounted on a printer."""


@dataclass(frozen=True)
class Machine:
    """Connected printer with its mounted parts.

    Attributes
    ----------
    profile, port : str
    ready : bool
        Whether it would take a print now.
    state : str
        Of the station: ready, busy, printing, halted, ...
    message : str
        What it is doing, or what to do.
    tip_mm : (x, y, z) or None, mm
        Where the tip stands; None where nobody knows.
    mounted : dict of str to str
        Profiles of needle, syringe, ink, dish and bath; empty for nothing there, or nobody said.
    dish_centre_mm : (x, y) or None, mm
    bath_depth_mm : float or None, mm
    ul_left : float or None, µL
        In the syringe, but for its dead volume.
    touch_off_due : bool
        Whether a needle is above a dish whose floor it hasn't touched.
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


class Printing(Protocol):
    """What prints: the station, or in tests a simulated printer."""

    def machine(self) -> Machine | None:
        """The printer as it is now; None where none is connected."""

    def start(self, order: Order) -> PrintClient:
        """Print, or attach to the order's print if it is going on."""

    def to_start(self, start_mm: tuple[float, float, float]) -> None:
        """Bring the tip to a job's start."""

    def heat(self, name: str, celsius: float) -> None:
        """Set a heater's target."""

    def temperatures(self) -> dict[str, tuple[float, float | None]]:
        """What each heater has and is to have, °C."""


def set_up_of(
    machine: Machine | None, before: JobSetUp, declared: tuple[float, float, float] | None = None
) -> JobSetUp:
    """The set-up with all that the printer knows better.

    Where the job declares its start, the tip must come there; else it starts where the tip stands.
    """
    if declared is not None:
        before = before.model_copy(update={"start_mm": declared})
    if machine is None:
        return before
    names = {key: name for key, name in machine.mounted.items() if name}
    said_mm = (
        {"start_mm": machine.tip_mm} if machine.tip_mm is not None and declared is None else {}
    )
    values = before.model_dump() | {"printer": machine.profile} | names | said_mm
    if machine.dish_centre_mm is not None and values["dish"]:
        values["dish_centre_mm"] = machine.dish_centre_mm
    if machine.bath_depth_mm is not None and machine.bath_depth_mm > 0 and values["dish"]:
        values["bath_depth_mm"] = machine.bath_depth_mm
    return JobSetUp.model_validate(values)
