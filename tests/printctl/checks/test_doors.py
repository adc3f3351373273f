"""Wrong set-ups have the same findings at every door: print, page, run, plate, simulate."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
import pytest
from rich.console import Console

from firmware_profiles import Bath, Ink, Needle, Printer, Syringe, load
from printctl.checks.kinds import Kind
from printctl.checks.made_for import header_lines, made_for
from printctl.checks.set_up import HeadLoading
from printctl.errors import PrinterFailedError, SafetyError
from printctl.machine.records.mounting import MountedParts, Mounting, save_mounting
from printctl.pipeline.context import RunContext
from printctl.pipeline.running.plate import dry_run as plate_dry_run
from printctl.pipeline.running.plate.job import wells_in_map
from printctl.pipeline.running.plate.wells import make_folders, plate_run
from printctl.pipeline.stages import printing
from printctl.pipeline.stages.paths import dry_run
from printctl.progress import StageBars
from printctl.recipe import parse_recipe
from printctl.run_folder.artefacts import GCODE, LINE_MAP
from printctl.run_folder.manifest import Manifest
from printctl.web.core import Core
from printctl.web.job import preflight
from printctl.web.job.check import check_job
from printctl.web.job.machine import Machine
from printctl.web.job.service import JobService
from printctl.web.job.set_up import JobSetUp
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace
from tests.printctl.cli.shell import Shell
from tests.printctl.web.job.conftest import OPERATOR
from tests.printctl.web.job.test_readiness import FakePrinting

START: Final = (100.0, 100.0, 25.0)
PORT: Final = "/dev/ttyNONE9"
PARTS: Final = {
    "syringe": "hamilton_1ml",
    "ink": "collagen_fresh",
    "needle": "30g_50mm",
    "bath": "gelatin_support",
    "dish": "box_80mm",
}
HEAD: Final = ["M85 S600", "G21", "G90", "M82", "M302 P1", "G92 X100 Y100 Z25 E0"]
BODY: Final = ["G1 Z5 F240", "G1 X105 E0.02 F600", "G1 X100 E0.04", "G1 Z25 F240"]
END: Final = ["M400"]
OF_THE_PAGE: Final = {Kind.CHECKLIST, Kind.OPERATOR, Kind.TIP, Kind.TOUCH_OFF}
"""What the page asks of a person before any print."""
WELLS: Final = "a plate's wells stand in place of a dish"
NO_PORT: Final = "it knows no machine that moves"
RECIPE_START: Final = "the start follows from the recipe, which the G-code was made from"
OWN_FILE: Final = "a run prints what it has written itself, with its record"


@dataclass(frozen=True)
class Case:
    """A set-up that is wrong in one thing.

    ``lines`` are put in before the lift's end; ``refused`` and ``warned`` are the kinds of findings
    that it must have at every door but those of ``not_at``, which can't express it, with the
    reason. ``mounted`` is on the machine behind a real port; None for a simulated one.
    """

    name: str
    refused: set[Kind]
    lines: list[str] = field(default_factory=list)
    text: Callable[[list[str]], list[str]] | None = None
    end: str = "\n"
    parts: Mapping[str, str] = field(default_factory=dict)
    unnamed: tuple[str, ...] = ()
    depth_mm: float = 8.0
    made_for: str = ""
    recorded: bool = True
    care: Mapping[str, Any] = field(default_factory=dict)
    start: tuple[float, float, float] | None = None
    mounted: Mapping[str, str] | None = None
    left_ul: float | None = None
    warned: set[Kind] = field(default_factory=set)
    not_at: Mapping[str, str] = field(default_factory=dict)

    @property
    def names(self) -> dict[str, str]:
        return {k: v for k, v in {**PARTS, **self.parts}.items() if k not in self.unnamed}

    def gcode(self) -> bytes:
        lines = [*HEAD, *BODY, *self.lines, *END]
        if self.text is not None:
            lines = self.text(lines)
        names = PARTS | dict(self.parts)
        load_of = HeadLoading(
            load(Syringe, names["syringe"]), load(Ink, names["ink"]), load(Needle, names["needle"])
        )
        bath = load(Bath, names["bath"])
        header = header_lines(made_for(load(Printer, "generic_marlin"), [load_of], bath))
        own = [
            f"{line[:-12]}{'0' * 12}" if line.startswith(f"printctl {self.made_for}:") else line
            for line in header
        ]
        if self.made_for == "dish":
            own.append(f"printctl dish: another #{'0' * 12}")
        own = own if self.recorded else []
        return "\n".join([*(f"; {line}" for line in own), *lines]).encode() + self.end.encode()


def without(word: str) -> Callable[[list[str]], list[str]]:
    return lambda lines: [line for line in lines if word not in line]


def changed(old: str, new: str) -> Callable[[list[str]], list[str]]:
    return lambda lines: [line.replace(old, new) for line in lines]


def late(*more: str) -> Callable[[list[str]], list[str]]:
    """Lines in the midst of the writing."""
    return lambda lines: [*lines[: len(HEAD) + 2], *more, *lines[len(HEAD) + 2 :]]


LONG: Final = [";LAYER_END:0", ";RELOAD", "G1 E29 F60", ";LAYER_END:1", ";RELOAD", "G1 E56 F60"]
OTHER_NEEDLE: Final = PARTS | {"needle": "28g"}
CELLS: Final = {"viability_source": "our protocol"}
REAL: Final = {"simulate": NO_PORT}

CASES: Final = [
    Case("nothing", set()),
    # travel, speed, plunger
    Case("x below its travel", {Kind.TRAVEL}, ["G0 Z100 F240", "G0 X-1 F6000"]),
    Case("y above its travel", {Kind.TRAVEL}, ["G0 Z100 F240", "G0 Y201 F6000"]),
    Case("z above its travel", {Kind.TRAVEL}, ["G0 Z201 F240"]),
    Case("feed above the limit of x", {Kind.SPEED}, ["G0 X110 F24000"]),
    Case("feed above the limit of z", {Kind.SPEED}, ["G0 Z30 F600"]),
    Case("feed above the limit of e", {Kind.SPEED}, ["G1 E1 F600"]),
    Case("too slow", {Kind.TOO_SLOW}, ["G1 X101 F12"]),
    Case("E beyond the syringe", {Kind.SYRINGE_VOLUME}, ["G1 E59.5 F60"]),
    Case("E beyond the drive", {Kind.SYRINGE_VOLUME, Kind.PLUNGER_TRAVEL}, ["G1 E61 F60"]),
    Case("plunger behind its begin", set(), ["G1 E-1 F60"], warned={Kind.PLUNGER_BEHIND}),
    Case("cold extrusion", {Kind.COLD_EXTRUSION}, text=without("M302")),
    # words
    Case("unknown code", {Kind.UNKNOWN_COMMAND}, ["M42 P4 S1"]),
    Case("unknown word", {Kind.BAD_LINE}, ["G1 X101 Q3 F600"]),
    Case("no command", {Kind.NO_COMMAND}, ["hello"]),
    Case("a code that no job may send", {Kind.FORBIDDEN_COMMAND}, ["M112"]),
    Case("relative places", {Kind.FORBIDDEN_COMMAND}, ["G91"]),
    Case("a line too long for the firmware", {Kind.LINE_LENGTH}, ["M117 " + "a long text " * 8]),
    Case("homing", {Kind.HOMING}, ["G28 X"]),
    Case("an arc without centre", {Kind.ARC}, ["G2 X101 Y101 F600"]),
    Case("motors off before the end", {Kind.MOTORS_OFF}, ["M84", "G0 Z30 F240"]),
    Case("a place told anew", {Kind.PLACE_REDEFINED}, ["G92 X50"]),
    Case("cut off", {Kind.CUT_OFF, Kind.LEFT_DOWN}, text=lambda lines: lines[:-2], end=""),
    Case("the needle left in the print", {Kind.LEFT_DOWN}, text=without("G1 Z25 F240")),
    # temperatures and firmware
    Case("ink too hot", {Kind.INK_TEMPERATURE}, ["M104 S37"]),
    Case("ink too cold", {Kind.INK_TEMPERATURE}, ["M104 S1"]),
    Case("bath too hot", {Kind.BATH_TEMPERATURE}, ["M140 S30"]),
    Case("a wait without end", {Kind.ENDLESS_WAIT}, ["M109 R10"]),
    Case("no switch-off", {Kind.SWITCH_OFF}, text=changed("M85 S600", "M85 S0")),
    # needle, dish, bath
    Case("needle at the floor", {Kind.FLOOR}, ["G0 Z0.5 F240", "G0 Z25"]),
    Case("writing above the bath", {Kind.BATH_SURFACE}, ["G1 X105 E0.06 F600", "G0 Z30 F240"]),
    Case(
        "needle into the dish's wall",
        {Kind.WALL},
        ["G0 Z48 F240", "G0 X139.5 F600"],
        not_at={"plate": WELLS},
    ),
    Case(
        "needle into the well's wall",
        {Kind.WALL},
        ["G0 Z6 F240", "G0 X116.8 F600", "G0 X100", "G0 Z25 F240"],
        parts={"dish": "petri_35mm"},
    ),
    Case(
        "too much in the dish",
        {Kind.BATH_DEPTH},
        parts={"dish": "petri_35mm"},
        depth_mm=9.0,
        not_at={"plate": WELLS},
    ),
    Case("a bath that doesn't set the ink", {Kind.CHEMISTRY}, parts={"ink": "alginate_fresh"}),
    Case("lines too wide", {Kind.BEAD_WIDTH}, text=changed("E0.02", "E0.9")),
    # made for another set-up
    *(
        Case(f"made for another {part}", {Kind.MADE_FOR}, made_for=part)
        for part in ("printer", "syringe", "needle", "ink", "bath")
    ),
    Case("made for another dish", {Kind.MADE_FOR}, made_for="dish", not_at={"plate": WELLS}),
    # cells and syringes
    Case("cells die before the end", {Kind.VIABILITY}, care={"viability_min": 0.1, **CELLS}),
    Case(
        "cells die in a change of syringe",
        {Kind.VIABILITY},
        LONG,
        text=changed("E56 F60", "E84 F60"),
        care={"reload": True, "reload_min": 30.0, "viability_min": 20.0, **CELLS},
    ),
    Case(
        "a change of unknown length",
        set(),
        LONG,
        text=changed("E56 F60", "E84 F60"),
        care={"reload": True, "viability_min": 20.0, **CELLS},
        warned={Kind.RELOAD_TIME},
    ),
    # the start
    Case(
        "a start of which a part is told",
        {Kind.START, Kind.FLOOR, Kind.HUB, Kind.WALL},
        text=changed("X100 Y100 Z25 E0", "X100 E0"),
        not_at={
            "run": RECIPE_START,
            "plate": RECIPE_START,
            "page": "the printer or the form says where the tip stands",
        },
    ),
    Case(
        "another start than the job tells",
        {Kind.START},
        start=(100.0, 100.0, 26.0),
        not_at={"run": RECIPE_START, "plate": RECIPE_START},
    ),
    # a real port
    Case("a machine as it should be", set(), mounted=PARTS, not_at=REAL),
    Case("another needle mounted", {Kind.OTHER_PART}, mounted=OTHER_NEEDLE, not_at=REAL),
    Case(
        "another syringe mounted",
        {Kind.OTHER_PART},
        mounted=PARTS | {"syringe": "hamilton_5ml"},
        not_at=REAL,
    ),
    Case(
        "another dish mounted",
        {Kind.OTHER_PART},
        mounted=PARTS | {"dish": "petri_60mm"},
        not_at=REAL | {"plate": WELLS},
    ),
    Case(
        "too little ink left",
        {Kind.INK_LEFT},
        ["G1 E20 F60"],
        mounted=PARTS,
        left_ul=100.0,
        not_at=REAL,
    ),
    Case(
        "a syringe that nobody named",
        {Kind.UNKNOWN_PART},
        unnamed=("syringe",),
        mounted={},
        not_at=REAL,
    ),
    Case(
        "a file without a record of its set-up",
        {Kind.UNRECORDED},
        recorded=False,
        mounted=PARTS,
        not_at=REAL | {"run": OWN_FILE, "plate": OWN_FILE},
    ),
    Case(
        "a dish that nobody named",
        {Kind.UNKNOWN_PART},
        unnamed=("dish",),
        mounted={k: v for k, v in PARTS.items() if k != "dish"},
        not_at=REAL | {"plate": WELLS},
    ),
]


@dataclass(frozen=True)
class Found:
    """Kinds of findings that refuse, and that warn; None where a door only says so in words."""

    refused: set[str]
    warned: set[str] | None


def of_rows(rows: list[dict[str, Any]]) -> Found:
    failed = [row for row in rows if not row["passed"]]
    return Found(
        {row["kind"] for row in failed if row["weight"] == "refuses"},
        {row["kind"] for row in failed if row["weight"] == "warns"},
    )


def mount(case: Case, **others: str) -> None:
    """Enter what is on the machine."""
    if case.mounted is None:
        return
    syringe, used_mm = load(Syringe, PARTS["syringe"]), None
    if case.left_ul is not None:
        used_mm = (syringe.volume_ul - syringe.dead_volume_ul - case.left_ul) / syringe.area_mm2
    parts = MountedParts(**{**case.mounted, **others})
    save_mounting(Mounting("generic_marlin", parts, used_mm))


def words(case: Case, *more: str) -> list[str]:
    names = [word for part, name in case.names.items() for word in (f"--{part}", name)]
    place = ["--dish-centre", "100,100", "--bath-depth", f"{case.depth_mm:g}"]
    care = [
        word
        for key, value in case.care.items()
        for word in (f"--{key.replace('_', '-')}", *([] if value is True else [str(value)]))
    ]
    start = [] if case.start is None else ["--start", ",".join(map(str, case.start))]
    return [*more, *names, *(place if "dish" in case.names else []), *care, *start]


def at_print(case: Case, folder: Path, shell: Shell) -> Found:
    (folder / "job.gcode").write_bytes(case.gcode())
    port = "simulated" if case.mounted is None else PORT
    given = words(case, "print", "job.gcode", "--printer", "generic_marlin", "--port", port)
    code, out, err = shell(*given, "--json")
    error = json.loads(out)["error"]
    if error["message"] == "begun":
        return Found(set(), None)
    assert code == 3, err
    return Found(set(error["checks"]), None)


def at_simulate(case: Case, folder: Path, shell: Shell) -> Found:
    (folder / "job.gcode").write_bytes(case.gcode())
    code, out, err = shell(*words(case, "simulate", "job.gcode"), "--json")
    facts = json.loads(out)
    assert code == (0 if facts["passed"] else 3), err
    return of_rows(facts["checks"])


def at_page(case: Case, folder: Path, shell: Shell) -> Found:
    workspace = Workspace(folder).make()
    mounted = {} if case.mounted is None else dict(case.mounted)
    machine = Machine(
        "generic_marlin",
        "simulated" if case.mounted is None else PORT,
        tip_mm=START,
        mounted=dict.fromkeys(PARTS, "") | mounted,
        ul_left=case.left_ul,
    )
    service = JobService(Core(ServeSettings(folder), workspace), FakePrinting(machine))
    try:
        job = service.upload("job.gcode", io.BytesIO(case.gcode())).id
        usual = JobSetUp().model_dump()  # what the form has where nobody said anything
        names = {part: case.names.get(part, usual[part]) for part in PARTS}
        dish = {"dish_centre_mm": (100.0, 100.0), "bath_depth_mm": case.depth_mm}
        given = {**names, **(dish if names["dish"] else {}), "care": case.care}
        set_up = JobSetUp.model_validate({**given, "start_mm": case.start or START})
        readiness = service.readiness(OPERATOR, job, set_up)
    finally:
        service.close()
    refused = {one.kind for one in readiness.refusals} - OF_THE_PAGE
    assert readiness.preflight is not None
    rows = readiness.preflight.model_dump(mode="json")["checks"]
    return Found(set(refused), {row["kind"] for row in rows if row["result"] == "warning"})


def recipe_of(case: Case, **more: Any) -> dict[str, Any]:
    """A recipe whose part is 4 mm wide, and whose start is 5 mm above its top."""
    names = case.names
    high_mm = START[2] - 5.0 - load(Bath, (PARTS | case.parts)["bath"]).floor_clearance_mm
    printer = {part: names[part] for part in ("syringe", "ink", "bath") if part in names}
    dish = {"dish": names.get("dish"), "dish_centre_mm": [100, 100], "bath_depth_mm": case.depth_mm}
    return {
        "schema": 1,
        "name": "doors",
        "tissue": {"shape": "block", "size_mm": [4, 4, high_mm]},
        "vasculature": {"network": "none.csv", "unit": "mm"},
        "toolpath": {"method": "fresh", "needle": names["needle"]},
        "printer": {
            **printer,
            **(dish if "dish" in names and "plate" not in more else {}),
            "port": "simulated" if case.mounted is None else PORT,
            "care": dict(case.care),
        },
        **more,
    }


def context_of(case: Case, folder: Path, **more: Any) -> RunContext:
    recipe = parse_recipe(recipe_of(case, **more), "doors.yaml")
    bars = StageBars(Console(file=io.StringIO()))
    (folder / "run").mkdir()
    return RunContext(recipe, folder, folder / "run", Manifest.load(folder / "run"), bars)


def judged(context: RunContext, case: Case, check: Callable[[], Any]) -> Found:
    """Let a run's dry run judge, and before a real print what is mounted."""
    refused: set[str] = set()
    try:
        summary, _ = check()
        context.manifest.stages["dry run"] = SimpleNamespace(summary=summary)  # type: ignore[assignment]
        if case.mounted is not None:
            printing.refuse_other_mounted(context)
    except SafetyError as exc:
        refused = set(exc.kinds)
    rows = json.loads((context.folder / dry_run.CHECKS).read_text())["checks"]
    warned = of_rows(rows).warned
    return Found(refused, warned)


def at_run(case: Case, folder: Path, shell: Shell) -> Found:
    context = context_of(case, folder)
    assert tuple(context.start_mm) == START
    (context.folder / GCODE).write_bytes(case.gcode())
    return judged(context, case, partial(dry_run.work, context, lambda *_: None))


def at_plate(case: Case, folder: Path, shell: Shell) -> Found:
    wells = {"profile": "corning_6", "wells": ["A1"], "a1_mm": [100, 100]}
    plate = wells | {"bath_depth_mm": case.depth_mm}
    whole = context_of(case, folder, plate=plate)
    run = plate_run(whole)
    make_folders(run)
    assert tuple(whole.start_mm) == START
    gcode = case.gcode()
    none = np.zeros(gcode.count(b"\n") + (not gcode.endswith(b"\n")), np.int16)
    common = {"source": none, "source_kind": np.array("layer")}
    for context, own in (
        (whole, wells_in_map(run, [none])),
        *((context, {"move": none}) for context in run.runs.values()),
    ):
        (context.folder / GCODE).write_bytes(gcode)
        np.savez(context.folder / LINE_MAP, **common, **own)
    mount(case, dish="")  # the plate stands in its place
    return judged(whole, case, partial(plate_dry_run.check_job, run, lambda *_: None))


DOORS: Final = {
    "print": at_print,
    "page": at_page,
    "run": at_run,
    "plate": at_plate,
    "simulate": at_simulate,
}


@pytest.fixture
def shell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Iterator[Shell]:
    """Commands in an empty folder; prints that aren't begun, and a page without other processes."""

    def begun(*_: object) -> None:
        raise PrinterFailedError("begun")

    def asked(gcode: Path, set_up: JobSetUp, table: Path) -> dict[str, Any]:
        facts: dict[str, Any] = json.loads(json.dumps(check_job(gcode, set_up, table)))
        return facts

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))
    monkeypatch.setattr("printctl.cli.machine.print_job.find_or_start", begun)
    monkeypatch.setattr(preflight, "_ask", asked)
    monkeypatch.setattr(dry_run, "predicting", lambda *_: ({}, []))
    return Shell(monkeypatch, capsys)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_every_door_finds_the_same(case: Case, tmp_path: Path, shell: Shell) -> None:
    mount(case)
    found = {}
    for door, at in DOORS.items():
        if door not in case.not_at:
            folder = tmp_path / door
            folder.mkdir()
            shell.monkeypatch.chdir(folder)
            found[door] = at(case, folder, shell)
    assert {door: one.refused for door, one in found.items()} == dict.fromkeys(found, case.refused)
    warned = {
        door: one.warned - one.refused for door, one in found.items() if one.warned is not None
    }
    assert warned == dict.fromkeys(warned, case.warned)


def test_there_are_forty_set_ups_and_each_exception_has_its_reason() -> None:
    assert len(CASES) > 40
    assert len({case.name for case in CASES}) == len(CASES)
    reasons = [reason for case in CASES for reason in case.not_at.values()]
    assert all(len(reason) > 10 for reason in reasons)
