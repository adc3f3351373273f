"""Printer interface of the Job page: mounted items, tip position, print start; set-up checks."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from printctl.checks.set_up import Check
from printctl.machine.link.client import PrintClient
from printctl.machine.printing import Order
from printctl.web.job.set_up import JobSetUp

AGREES_MM = 0.05
"""A tip that stands farther from the job's start would write beside its place."""


@dataclass(frozen=True)
class Machine:
    """Connected printer with its mounted parts.

    Attributes
    ----------
    profile, port : str
    ready : bool
        Whether it would take a print now.
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
    message: str = ""
    tip_mm: tuple[float, float, float] | None = None
    mounted: dict[str, str] = field(default_factory=dict)
    dish_centre_mm: tuple[float, float] | None = None
    bath_depth_mm: float | None = None
    ul_left: float | None = None
    touch_off_due: bool = False

    @property
    def words(self) -> str:
        """What a person confirms before it moves."""
        return f"{Path(self.profile).stem} on {self.port}"


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


def mounted_checks(machine: Machine | None, set_up: JobSetUp, ink_ul: float) -> list[Check]:
    """What was said of the job's set-up against what is known of the printer.

    Parameters
    ----------
    machine : Machine or None
    set_up : JobSetUp
    ink_ul : float, µL
        What the job takes out of the syringe.
    """
    if machine is None:
        return [_asked("printer", "none is connected; connect it on the page Printer")]
    checks = [] if machine.ready else [_asked("printer", f"isn't ready: {machine.message}")]
    if machine.profile != set_up.printer:
        checks.append(
            _asked(
                "printer's profile",
                f"{machine.profile} is connected, and {set_up.printer} was checked; choose "
                "the connected one",
            )
        )
    for key, there in machine.mounted.items():
        wanted = getattr(set_up, key)
        if there and wanted != there:
            checks.append(
                _asked(
                    key,
                    f"{there} is mounted, and {wanted or 'none'} was checked; choose what is "
                    "mounted, or say on the page Printer what is",
                )
            )
    if machine.touch_off_due:
        checks.append(
            _asked(
                "needle's touch-off",
                f"{machine.mounted.get('needle')} hasn't touched the dish's floor since it was put "
                "on; touch it off on the page Printer",
            )
        )
    return [*checks, *_place(machine, set_up), *_enough(machine, set_up, ink_ul)]


def _asked(what: str, remedy: str) -> Check:
    return Check(what, 0, 0, "", False, "", remedy)


def _place(machine: Machine, set_up: JobSetUp) -> list[Check]:
    if machine.tip_mm is None:
        return [
            _asked(
                "where the tip stands",
                "not known to the printer; home it without the needle, or touch off and tell the "
                "position on the page Printer",
            )
        ]
    away = max(abs(a - b) for a, b in zip(machine.tip_mm, set_up.start_mm, strict=True))
    remedy = "move the tip to the start, or take the place where it stands as the start"
    return [
        Check("tip's distance from the start", away, AGREES_MM, "mm", away <= AGREES_MM, "", remedy)
    ]


def _enough(machine: Machine, set_up: JobSetUp, ink_ul: float) -> list[Check]:
    if machine.ul_left is None or set_up.care.reload:
        return []
    remedy = "fill the syringe (page Printer), or allow changes of syringe"
    return [
        Check(
            "ink that the job takes, of what is in the syringe",
            ink_ul,
            machine.ul_left,
            "µL",
            ink_ul <= machine.ul_left,
            "",
            remedy,
        )
    ]
