"""All that refuses a start is listed at once, and nothing else refuses it."""

from __future__ import annotations

import io
from dataclasses import dataclass, field, replace
from typing import Any

import pytest

from printctl.checks.kinds import Kind
from printctl.errors import SafetyError
from printctl.machine.process.clients.client import PrintClient
from printctl.machine.process.orders import Order
from printctl.web.core import Core
from printctl.web.job.aftercare import checklist
from printctl.web.job.machine import Machine, StationPrinting
from printctl.web.job.readiness import machine_refusals
from printctl.web.job.record import LASTING_POINTS
from printctl.web.job.service import JobService
from printctl.web.job.set_up import JobSetUp
from tests.printctl.checks.preflight.test_shaft_checks import START, job
from tests.printctl.machine.link.layered import layered
from tests.printctl.web.job.conftest import OPERATOR, OTHER, add

POINTS = {point["id"]: True for point in checklist()["before"]}
MOUNTED = {"needle": "30g", "syringe": "hamilton_1ml", "ink": "collagen_fresh"}
MACHINE = Machine("generic_marlin", "/dev/ttyUSB0", tip_mm=(0.0, 0.0, 0.0), mounted=MOUNTED)


class BegunError(Exception):
    """The start came through to the printer."""


@dataclass
class FakePrinting(StationPrinting):
    """A printer whose state a test sets; it begins no print."""

    now: Machine | None = None
    temperatures_c: dict[str, tuple[float, float | None]] = field(default_factory=dict)

    def machine(self) -> Machine | None:
        return self.now

    def start(self, order: Order) -> PrintClient:
        raise BegunError

    def to_start(self, start_mm: tuple[float, float, float]) -> None:
        assert self.now is not None
        self.now = replace(self.now, tip_mm=start_mm)

    def heat(self, name: str, celsius: float) -> None:
        self.temperatures_c[name] = celsius, celsius

    def temperatures(self) -> dict[str, tuple[float, float | None]]:
        return self.temperatures_c


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({}, []),
        ({"ready": False, "state": "halted"}, [("printer", "reconnect")]),
        ({"ready": False, "state": "busy"}, [("printer", "")]),
        ({"ready": False, "state": "printing"}, [("printer", "see_print")]),
        ({"ready": False, "state": "halting"}, [("printer", "")]),
        ({"profile": "lulzbot"}, [("printer's profile", "mount")]),
        ({"mounted": MOUNTED | {"needle": "25g"}}, [("needle", "mount")]),
        ({"mounted": MOUNTED | {"needle": "", "ink": ""}}, [("needle", "mount"), ("ink", "mount")]),
        ({"mounted": {}, "port": "simulated"}, []),
        ({"touch_off_due": True}, [("needle's touch-off", "touch_off")]),
        ({"touch_off_due": True, "port": "simulated"}, []),
        ({"tip_mm": None}, [("where the tip stands", "set_position")]),
        ({"tip_mm": (0.04, 0.04, 0.0)}, [("tip's distance from the start", "to_start")]),
    ],
)
def test_each_state_of_the_machine_has_its_remedy(
    change: dict[str, Any], found: list[tuple[str, str]]
) -> None:
    set_up = JobSetUp(needle="30g", bath="none", dish="none")
    refusals = machine_refusals(replace(MACHINE, **change), set_up)
    assert [(one.what, one.action) for one in refusals] == found


def test_a_bath_or_dish_that_nobody_entered_is_asked_for() -> None:
    refusals = [*machine_refusals(MACHINE, JobSetUp(needle="30g"))]
    assert [(one.what, one.action, one.about) for one in refusals] == [
        ("bath", "mount", "bath"),
        ("dish", "mount", "dish"),
    ]


@pytest.fixture
def printing() -> FakePrinting:
    return FakePrinting()


@pytest.fixture
def room(core: Core, printing: FakePrinting) -> Any:
    made = JobService(core, printing)
    yield made
    made.close()


def listed(room: JobService, job: str) -> list[str]:
    """Actions of what refuses a start, which must refuse it by the same words."""
    readiness = room.readiness(OPERATOR, job)
    set_up = room.set_up(job)
    words = MACHINE.words
    if readiness.ready:
        with pytest.raises(BegunError):
            room.start(OPERATOR, job, set_up, words)
    else:
        with pytest.raises(SafetyError) as refused:
            room.start(OPERATOR, job, set_up, words)
        assert all(one.sentence() in str(refused.value) for one in readiness.refusals)
    return [one.action for one in readiness.refusals]


def test_six_refusals_are_listed_at_once_and_mended_one_by_one(
    core: Core, room: JobService, printing: FakePrinting
) -> None:
    job(core.workspace.root / "jobs", 0, 1)
    crossing = "file~part.gcode"
    printing.now = replace(MACHINE, ul_left=0.5)
    nothing = {"bath": "none", "dish": "none"}
    room.keep_set_up(crossing, room.set_up(crossing).model_copy(update=nothing))
    ticks, checks = ["tick"] * len(POINTS), ["fill", "for_mounted", "accept_crossings"]
    assert listed(room, crossing) == ["to_start", "operator", *ticks, *checks]
    room.to_start(OPERATOR, crossing, START)
    assert "to_start" not in listed(room, crossing)
    room.write_down(OPERATOR, crossing, {"operator": "Ada"})
    assert listed(room, crossing) == [*ticks, *checks]
    room.write_down(OPERATOR, crossing, {"ticked": POINTS})
    assert listed(room, crossing) == checks
    room.confirm_set_up(OPERATOR, crossing)
    assert listed(room, crossing) == ["fill", "accept_crossings"]
    printing.now = replace(printing.now, ul_left=2.0)
    assert listed(room, crossing) == ["accept_crossings"]
    set_up = room.set_up(crossing)
    room.keep_set_up(crossing, set_up.model_copy(update={"accept_crossings": True}))
    assert listed(room, crossing) == []
    # Another needle was never confirmed for this file.
    printing.now = replace(printing.now, mounted=MOUNTED | {"needle": "27g"})
    other = room.set_up(crossing).model_copy(update={"needle": "27g"})
    room.keep_set_up(crossing, other)
    assert "for_mounted" in listed(room, crossing)


def test_without_waiting_only_what_is_known_is_listed(
    room: JobService, printing: FakePrinting
) -> None:
    name = add(room, layers=2, moves=5)
    first = room.readiness(OPERATOR, name, wait=False)
    assert not first.checked
    assert not first.ready
    assert [one.action for one in first.refusals] == ["connect"]
    printing.now = replace(MACHINE, ready=False, state="busy")
    assert not room.readiness(OPERATOR, name).checked  # the tip moves: it would be checked anew
    printing.now = None
    assert room.readiness(OPERATOR, name).checked
    assert room.readiness(OPERATOR, name, wait=False).checked


def test_another_browsers_controls_and_a_job_that_cant_be_read_refuse(
    core: Core, room: JobService
) -> None:
    bad = room.upload("relative.gcode", io.BytesIO(b"G91\nM83\nG1 X1 E1\n")).id
    core.controls.take(OTHER)
    refusals = room.readiness(OPERATOR, bad).refusals
    assert [one.action for one in refusals[:2]] == ["controls", "connect"]
    failed = next(one for one in refusals if one.kind == Kind.FORBIDDEN_COMMAND)
    assert failed.sentence().startswith("G91 is not allowed in a job: 1, limit 0 (line 1)")


def test_a_simulated_printer_wants_no_name_and_no_points(
    room: JobService, printing: FakePrinting
) -> None:
    printing.now = replace(MACHINE, port="simulated", tip_mm=(50.0, 50.0, 10.0))
    assert room.readiness(OPERATOR, add(room, layers=2, moves=5)).ready


def test_the_next_record_remembers_lots_and_what_lasts(room: JobService) -> None:
    first, second = add(room, layers=1, moves=5), add(room, "other.gcode", layers=1, moves=6)
    said = {"operator": "Ada", "ink_lot": "A7", "mixed_at": 1.0, "ticked": POINTS}
    room.write_down(OPERATOR, first, said)
    assert room.record(second).operator == ""  # nothing was printed yet
    room.records.mark(room.records.current(first), "Ada", started=1.0, ended=2.0)
    record = room.record(first)
    assert (record.operator, record.ink_lot, record.mixed_at) == ("Ada", "A7", None)
    assert record.ticked == dict.fromkeys(LASTING_POINTS, True)


def test_a_job_that_needs_several_syringes_wants_changes_allowed_and_the_first_one_full(
    room: JobService, printing: FakePrinting
) -> None:
    """Two syringes' ink: a change is planned where the first one, if full, is empty."""
    name = room.upload("long.gcode", io.BytesIO(layered(30, 700))).id
    printing.now = replace(MACHINE, port="simulated", tip_mm=(50.0, 50.0, 10.0), ul_left=900.0)
    refusals = room.readiness(OPERATOR, name).refusals
    assert {one.action for one in refusals} == {"fill", "reload"}
    set_up = room.set_up(name)
    care = set_up.care.model_copy(update={"reload": True})
    room.keep_set_up(name, set_up.model_copy(update={"care": care}))
    first = room.readiness(OPERATOR, name)
    assert first.preflight is not None
    assert first.preflight.reload_at
    assert [one.action for one in first.refusals] == ["fill"]
    needed_ul = first.refusals[0].value
    assert needed_ul is not None
    assert 900.0 < needed_ul <= 1000.0  # a Hamilton syringe of 1 mL, up to a mark for a change
    printing.now = replace(printing.now, ul_left=needed_ul)
    assert room.readiness(OPERATOR, name).ready
