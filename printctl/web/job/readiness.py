"""List all that refuses a print's start, each with its remedy and what helps at the page."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

from firmware_profiles import Printer, load
from printctl.checks.kinds import Kind
from printctl.checks.made_for import MadeFor
from printctl.checks.set_up import NONE, Check
from printctl.machine.control.idle.station_status import StationState
from printctl.machine.job.syringes import OF_THE_SYRINGE
from printctl.machine.prints.mounted import is_confirmed, left_check, part_checks
from printctl.machine.process.orders import ASIDE_MM
from printctl.web.job.aftercare import checklist
from printctl.web.job.machine import Machine
from printctl.web.job.preflight import CheckRow, Preflight, PreflightReport, row
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


@dataclass(frozen=True)
class Refusal:
    """One reason for which a start is refused: ``what`` was looked at, and its ``remedy``.

    ``value`` and ``limit`` are as in `CheckRow`; None for a question to a person.
    """

    kind: Kind
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
        return CheckRow(
            self.kind, self.what, "failed", *numbers, False, self.place, self.remedy, "refuses"
        )


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
        yield Refusal(
            Kind.PRINTER, "printer", "none is connected; connect one, or rehearse", "connect"
        )
        return
    if not machine.ready:
        yield _not_ready(machine)
    if machine.profile != set_up.printer:
        yield Refusal(
            Kind.OTHER_PART,
            "printer's profile",
            f"{machine.profile} is connected, and {set_up.printer} was checked; choose the "
            "connected one",
            "mount",
            "printer",
        )
    yield from _parts(machine, set_up)
    if machine.touch_off_due and not machine.simulated:
        yield Refusal(
            Kind.TOUCH_OFF,
            "needle's touch-off",
            f"{machine.mounted.get('needle')} hasn't touched the dish's floor since it was put on; "
            "touch it off",
            "touch_off",
        )
    yield from _tip(machine, set_up)


def _parts(machine: Machine, set_up: JobSetUp) -> Iterator[Refusal]:
    """Yield other parts than were checked, and before a real print parts that nobody entered.

    What several heads hold can't be entered at a station: there each must be chosen.
    """
    names = {part: getattr(set_up, part) for part in PARTS}
    real = not machine.simulated and machine.profile == set_up.printer  # else refused by itself
    several = real and bool(load(Printer, machine.profile).heads)
    assumed = [part for part, name in names.items() if name != NONE and not (several and name)]
    for check in part_checks(machine.there, names, assumed if real else ()):
        part = check.check
        there, wanted = machine.mounted.get(part), names[part] or "none"
        remedy = (
            f"{there} is mounted, and {wanted} was checked; choose what is mounted, or say what is"
            if check.kind == Kind.OTHER_PART
            else f"which one is there isn't known ({wanted} was checked); enter what is there, or "
            "that nothing is"
        )
        yield Refusal(check.kind, part, remedy, "mount", part)


def record_refusal(machine: Machine | None, sha256: str, mounted: MadeFor) -> Iterator[Refusal]:
    """Yield a file that doesn't record its set-up, until a person has confirmed it for this one."""
    if machine is None or machine.simulated or is_confirmed(sha256, mounted):
        return
    yield Refusal(
        Kind.UNRECORDED,
        "set-up not recorded in the file",
        "not recorded in the file; confirm that it was made for what is mounted",
        "for_mounted",
    )


def _not_ready(machine: Machine) -> Refusal:
    if machine.state == StationState.HALTED:
        return Refusal(
            Kind.PRINTER, "printer", f"it was halted ({machine.message}); connect anew", "reconnect"
        )
    if machine.state in (StationState.BUSY, StationState.CONNECTING):
        return Refusal(
            Kind.PRINTER, "printer", f"it isn't ready yet ({machine.message}); wait a moment"
        )
    if machine.state == StationState.PRINTING:
        what = machine.message.removeprefix(f"{StationState.PRINTING}: ")
        return Refusal(
            Kind.PRINTER, "printer", f"it prints already ({what}); wait for its end", "see_print"
        )
    return Refusal(
        Kind.PRINTER, "printer", f"it isn't ready ({machine.message}); wait for the end of that"
    )


def _tip(machine: Machine, set_up: JobSetUp) -> Iterator[Refusal]:
    if machine.tip_mm is None:
        yield Refusal(
            Kind.TIP,
            "where the tip stands",
            "not known to the printer; home it without the needle, or touch off and say where the "
            "tip is (Printer page)",
            "set_position",
        )
        return
    away = math.dist(machine.tip_mm, set_up.start_mm)
    if away > ASIDE_MM:
        yield Refusal(
            Kind.TIP,
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
    check = left_check(checked.plan.first_ul, machine.ul_left)
    if not check.passed:
        remedy = (
            "it would run dry; put a full syringe in and say so, or change it on the Printer page"
        )
        yield replace(check_refusal(check), remedy=remedy, action="fill")


def record_refusals(machine: Machine | None, record: PrintRecord) -> Iterator[Refusal]:
    """Yield what a person must write or look at before a machine moves; nothing of a simulation."""
    if machine is None or machine.simulated:
        return
    if not record.operator.strip():
        yield Refusal(
            Kind.OPERATOR, "operator", "the record must say who prints; write a name", "operator"
        )
    for point in checklist()["before"]:
        if not record.ticked.get(point["id"]):
            yield Refusal(Kind.CHECKLIST, "look at the machine", point["text"], "tick", point["id"])


def check_refusal(check: Check, offers_reload: bool = False) -> Refusal:
    """Return a failed check of the job, with what helps."""
    shown, remedy, about = row(check), check.remedy, ""
    action: Action = ""
    if check.kind == Kind.SHAFT_CROSSING:  # its other remedies are options of the command line
        action = "accept_crossings"
        remedy = f"{remedy.partition(';')[0]}; use a thinner needle, or accept it"
    elif offers_reload and check.kind in OF_THE_SYRINGE:
        action = "reload"
    elif about := next((one for one in PARTS if f"{one}:" in check.place), ""):
        action = "mount"
    numbers = shown.value, shown.limit, check.unit, check.place
    return Refusal(check.kind, check.check, remedy, action, about, *numbers)
