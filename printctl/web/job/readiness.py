"""List all that refuses a print's start, each with its remedy and what helps at the page."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

from firmware_profiles import Printer, load
from printctl.checks.made_for import MadeFor
from printctl.checks.set_up import NONE, Check
from printctl.machine.control.idle.station_status import StationState
from printctl.machine.prints.mounted import is_confirmed
from printctl.machine.process.orders import ASIDE_MM
from printctl.web.job.aftercare import checklist
from printctl.web.job.machine import Machine
from printctl.web.job.preflight import CheckRow, Preflight, PreflightReport, load_table, row
from printctl.web.job.record import PrintRecord
from printctl.web.job.set_up import JobSetUp
from printctl.web.profile_store import PARTS

Action = Literal[
    "",  # nothing
    "controls",  # take them
    "connect",
    "reconnect",
    "see_print",  # that goes on
    "mount",  # say what is mounted: `about` is the part
    "set_position",
    "to_start",  # move the tip
    "touch_off",
    "fill",  # say that a full syringe was put in
    "reload",  # allow changes of syringe
    "accept_crossings",
    "operator",
    "tick",  # `about` is the point
    "for_mounted",  # confirm that the file was made for what is mounted
]
"""What the page can do about a refusal."""
_SHAFT: Final = "vessels that the needle's shaft passes through"
_LONG_ENOUGH: Final = "the syringe is then changed before line"


@dataclass(frozen=True)
class Refusal:
    """One reason for which a start is refused: ``what`` was looked at, and its ``remedy``.

    ``value`` and ``limit`` are as in `CheckRow`; None for a question to a person.
    """

    what: str
    remedy: str
    action: Action = ""
    about: str = ""
    value: float | None = None
    limit: float | None = None
    unit: str = ""
    place: str = ""

    def sentence(self) -> str:
        """Return it for a message."""
        where = f" ({self.place})" if self.place else ""
        if self.value is None or self.limit is None:
            return f"{self.what}{where}: {self.remedy}"
        value = f"{self.value:g} {self.unit}".rstrip()
        return f"{self.what}: {value}, limit {self.limit:g}{where}; {self.remedy}"

    def as_row(self) -> CheckRow:
        """Return it as a failed check."""
        numbers = self.value, self.limit, self.unit
        return CheckRow(self.what, "failed", *numbers, False, self.place, self.remedy, "refuses")


@dataclass(frozen=True)
class Readiness:
    """Whether a job's print may begin: it was checked, and nothing refuses it.

    ``checked`` is whether the job itself has been checked with this set-up; its refusals are
    unknown before. ``key`` is empty for a set-up that can't be used.
    """

    job: str
    ready: bool
    checked: bool
    key: str
    refusals: tuple[Refusal, ...]
    machine: Machine | None
    preflight: PreflightReport | None


def machine_refusals(machine: Machine | None, set_up: JobSetUp) -> Iterator[Refusal]:
    """Yield what the printer's state, what is mounted and the tip's place refuse."""
    if machine is None:
        yield Refusal("printer", "none is connected; connect one, or rehearse", "connect")
        return
    if not machine.ready:
        yield _not_ready(machine)
    if machine.profile != set_up.printer:
        yield Refusal(
            "printer's profile",
            f"{machine.profile} is connected, and {set_up.printer} was checked; choose the "
            "connected one",
            "mount",
            "printer",
        )
    for part, there in machine.mounted.items():
        wanted = getattr(set_up, part)
        if there and wanted != there:
            yield Refusal(
                part,
                f"{there} is mounted, and {wanted or 'none'} was checked; choose what is mounted, "
                "or say what is",
                "mount",
                part,
            )
    yield from _unknown_parts(machine, set_up)
    if machine.touch_off_due and not machine.simulated:
        yield Refusal(
            "needle's touch-off",
            f"{machine.mounted.get('needle')} hasn't touched the dish's floor since it was put on; "
            "touch it off",
            "touch_off",
        )
    yield from _tip(machine, set_up)


def _unknown_parts(machine: Machine, set_up: JobSetUp) -> Iterator[Refusal]:
    """Yield parts that nobody entered; what several heads hold can't be entered at a station."""
    same = machine.profile == set_up.printer  # another one is refused by itself
    if machine.simulated or not same or load(Printer, machine.profile).heads:
        return
    for part in ("syringe", "needle", "ink", "bath", "dish"):
        checked = getattr(set_up, part)
        if not machine.mounted.get(part) and checked != NONE:
            yield Refusal(
                part,
                f"which one is there isn't known ({checked or 'none'} was checked); enter what is "
                "there, or that nothing is",
                "mount",
                part,
            )


def record_refusal(machine: Machine | None, sha256: str, mounted: MadeFor) -> Iterator[Refusal]:
    """Yield a file that doesn't record its set-up, until a person has confirmed it for this one."""
    if machine is None or machine.simulated or is_confirmed(sha256, mounted):
        return
    yield Refusal(
        "set-up not recorded in the file",
        "not recorded in the file; confirm that it was made for what is mounted",
        "for_mounted",
    )


def _not_ready(machine: Machine) -> Refusal:
    if machine.state == StationState.HALTED:
        return Refusal("printer", f"it was halted ({machine.message}); connect anew", "reconnect")
    if machine.state in (StationState.BUSY, StationState.CONNECTING):
        return Refusal("printer", f"it isn't ready yet ({machine.message}); wait a moment")
    if machine.state == StationState.PRINTING:
        what = machine.message.removeprefix(f"{StationState.PRINTING}: ")
        return Refusal("printer", f"it prints already ({what}); wait for its end", "see_print")
    return Refusal("printer", f"it isn't ready ({machine.message}); wait for the end of that")


def _tip(machine: Machine, set_up: JobSetUp) -> Iterator[Refusal]:
    if machine.tip_mm is None:
        yield Refusal(
            "where the tip stands",
            "not known to the printer; home it without the needle, or touch off and say where the "
            "tip is (Printer page)",
            "set_position",
        )
        return
    away = math.dist(machine.tip_mm, set_up.start_mm)
    if away > ASIDE_MM:
        yield Refusal(
            "tip's distance from the start",
            "the part would be written as far beside its place; move the tip to the start",
            "to_start",
            value=away,
            limit=ASIDE_MM,
            unit="mm",
        )


def ink_refusals(machine: Machine | None, checked: Preflight) -> Iterator[Refusal]:
    """Yield a syringe that holds less than the job takes out of it before its first change.

    Changes of syringe are planned as if the first one were full.
    """
    if machine is None or machine.ul_left is None:
        return
    needed_ul = float(checked.facts.get("ink_pushed_ul", 0.0))
    if changes := checked.facts["reload_at"]:
        needed_ul = float(load_table(checked.table).ink_ul[changes[0]])
    if needed_ul > machine.ul_left:
        yield Refusal(
            "ink that the job takes, of what is in the syringe",
            "it would run dry; put a full syringe in and say so, or change it on the Printer page",
            "fill",
            value=needed_ul,
            limit=machine.ul_left,
            unit="µL",
        )


def homing_refusals(machine: Machine | None, line: int) -> Iterator[Refusal]:
    """Yield a job that homes the machine, in a line, while a needle is mounted."""
    needle = "" if machine is None else machine.mounted.get("needle", "")
    if line and needle:
        yield Refusal(
            "homing",
            f"the job homes the machine, which would drive the needle {needle} into what is "
            "below; take the line out, and touch off instead",
            place=f"line {line}",
        )


def record_refusals(machine: Machine | None, record: PrintRecord) -> Iterator[Refusal]:
    """Yield what a person must write or look at before a machine moves; nothing of a simulation."""
    if machine is None or machine.simulated:
        return
    if not record.operator.strip():
        yield Refusal("operator", "the record must say who prints; write a name", "operator")
    for point in checklist()["before"]:
        if not record.ticked.get(point["id"]):
            yield Refusal("look at the machine", point["text"], "tick", point["id"])


def check_refusal(check: Check) -> Refusal:
    """Return a failed check of the job, with what helps."""
    shown, remedy, about = row(check), check.remedy, ""
    action: Action = ""
    if check.check.endswith(_SHAFT):  # its other remedies are options of the command line
        action = "accept_crossings"
        remedy = f"{remedy.partition(';')[0]}; use a thinner needle, or accept it"
    elif _LONG_ENOUGH in remedy:
        action = "reload"
    elif about := next((one for one in PARTS if f"{one}:" in check.place), ""):
        action = "mount"
    return Refusal(
        check.check, remedy, action, about, shown.value, shown.limit, check.unit, check.place
    )
