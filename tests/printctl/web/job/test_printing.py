"""A print on the real simulated printer, through the station."""

from __future__ import annotations

import errno
import json
import logging
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import closing, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import pytest
import yaml
from typer.testing import CliRunner

from gcode.motion.executed import ExecutedMotion
from printctl.cli.main import app
from printctl.errors import SafetyError
from printctl.history.index import PrintHistory
from printctl.history.query import HistoryQuery
from printctl.machine.errors import Refused
from printctl.machine.job.marks import MarkKind
from printctl.machine.prints.state import PrintAction
from printctl.machine.process.clients.client import Station
from printctl.machine.process.clients.starting import connect
from printctl.machine.process.contact import load_station
from printctl.machine.process.simulated import record_for, was_simulated
from printctl.machine.records.folders import read_notes
from printctl.machine.records.journal import Journal
from printctl.machine.records.record import JOURNAL, ContactRecord, load_record
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState, Status
from printctl.observe.deciding import Limits
from printctl.observe.devices import DeviceSettings
from printctl.observe.observer_launch import ObserverError
from printctl.observe.order import ObserverOrder
from printctl.observe.records import ORDER_FILE, READY_FILE, read_looks
from printctl.run_folder.artefacts import GCODE
from printctl.run_folder.manifest import Manifest
from printctl.web.errors import ConflictError, NotInControlError
from printctl.web.history.service import HistoryService
from printctl.web.job import print_commands
from printctl.web.job.jobs import entry_of
from printctl.web.job.print_commands import PauseRequest, RecoverRequest, ResumeRequest
from printctl.web.job.record import Records
from printctl.web.job.service import JobService
from tests.printctl.machine.link.layered import layered
from tests.printctl.machine.link.test_journal import begun
from tests.printctl.web.job.conftest import MOUNTED, OPERATOR, OTHER, START, WORDS, add, ready, shut
from tests.sim_process import printer_process
from tests.waiting import wait_for as heard


def until(service: JobService, job: str, *states: LinkState):
    return until_so(service, job, ended_as(*states))


@pytest.mark.parametrize("state", [LinkState.PRINTING, LinkState.RESUMING])
def test_resume_of_a_print_that_isnt_paused_is_refused(service, monkeypatch, state):
    job, client = add(service), MagicMock(status=Status(state))
    client.__enter__.return_value = client
    monkeypatch.setattr(print_commands, "attach", lambda folder: client)
    asked_twice = state is LinkState.RESUMING
    with nullcontext() if asked_twice else pytest.raises(ConflictError, match="isn't paused"):
        assert service.hands.resume(OPERATOR, job, ResumeRequest()).state is state
    client.resume.assert_not_called()


def test_a_print_is_started_held_gone_on_with_and_done(service, station):
    job = add(service)
    said = ready(service, job)
    assert said.needle == "28g"
    assert said.start_mm == (50.0, 50.0, 10.0)
    begun = service.start(OPERATOR, job, said, WORDS)
    assert service.start(OPERATOR, job, said, WORDS).journal.started == begun.journal.started
    service.hands.pause(OPERATOR, job, PauseRequest(after="layer"))
    service.hands.pause(OPERATOR, job, PauseRequest(after="layer"))
    held = until(service, job, LinkState.PAUSED)
    assert held.progress is not None
    assert 0 < held.progress.share < 1
    assert held.progress.layers == 6
    service.hands.resume(OPERATOR, job, ResumeRequest())
    done = until(service, job, LinkState.DONE)
    assert done.progress is not None
    assert done.progress.commands == done.progress.commands_total
    assert done.progress.layers_done == 6
    assert done.progress.ink_ul == pytest.approx(done.progress.ink_total_ul)
    folder = service.core.workspace.print_folder(job)
    kept = json.loads((folder / "record.json").read_text())
    assert kept["values"]["operator"] == "Ada"
    assert kept["state"] == "done"
    assert kept["changes"]
    assert service.record(job).operator == "Ada"  # a new print's record remembers the last one


@pytest.mark.slow
def test_a_new_server_finds_the_print_that_goes_on(core, service, station):
    job = add(service)
    service.start(OPERATOR, job, ready(service, job), WORDS)
    service.close()
    again = JobService(core)
    try:
        found = until(again, job, LinkState.PRINTING)
        assert again.prints.current() is not None
        assert not found.status.ended
        again.hands.cancel(job)
        stopped = until(again, job, LinkState.STOPPED)
        assert stopped.status.position_known
        heard(lambda: core.events.latest["print"]["state"] == "stopped")
        not_followed_anew(again, job)
    finally:
        again.close()


def not_followed_anew(service: JobService, job: str) -> None:
    """A process that told its end and still lives has only a bare first word for another."""
    folder, prints = service.core.workspace.print_folder(job), service.prints
    written, before = load_record(folder), service.prints._followers[job]
    replace(written, status={}, address="still here").save(folder)
    prints.follow(job, folder)
    assert prints._followers[job] is before
    replace(written, status={}, session="another").save(folder)
    prints.follow(job, folder)
    assert prints._followers[job] is not before


def test_a_start_wants_machine_set_up_and_controls(service, station):
    job = add(service)
    said = service.set_up(job)
    with pytest.raises(ConflictError, match="confirm that one"):
        service.start(OPERATOR, job, said, "another on /dev/ttyUSB0")
    service.core.controls.take(OPERATOR)  # the set-up may have taken longer than the lease
    with pytest.raises(NotInControlError):
        service.start(OTHER, job, said, WORDS)
    away = said.model_copy(update={"start_mm": (60.0, 50.0, 10.0)})
    with pytest.raises(SafetyError, match=r"tip's distance from the start: 10 mm, limit 0\.05"):
        service.start(OPERATOR, job, away, WORDS)
    assert service.prints.heard(job) is None


# --- print on a full disk: state reported, end recorded later
def ended(service: JobService) -> tuple[str, str]:
    """Leave a print that is over and whose end isn't noted; give its job and record."""
    job = add(service)
    folder = service.core.workspace.print_folder(job)
    folder.mkdir(parents=True)
    with closing(Journal(folder / JOURNAL)) as journal:
        journal.add("job", name=job, path="", sha256="", lines=1, started=time.time())
    status = Status(LinkState.DONE).to_dict()
    ContactRecord(0, "", "", "", "generic_marlin", "p", time.time(), status=status).save(folder)
    record = service.records.current(job)
    service.records.mark(record, "one", started=time.time())
    return job, record


def test_state_is_told_though_its_end_can_t_be_noted(
    service: JobService, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    job, record = ended(service)
    write = service.records.mark

    def full(*asked: object, **more: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(service.records, "mark", full)
    with caplog.at_level(logging.ERROR):
        for _ in range(3):
            heard = service.prints.heard(job)
            assert heard is not None
            assert heard.status.state is LinkState.DONE
    assert len([one for one in caplog.records if "can't be noted" in one.message]) == 1
    space_came = time.time()
    monkeypatch.setattr(service.records, "mark", write)
    service.prints.heard(job)
    kept = service.records.load(record)
    assert kept["state"] == "done"
    assert kept["ended"] < space_came


# --- notes made after a print's end: in the history, with their print
@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))


def until_filed(operators: list[str]) -> None:
    """The history is told in a thread of its own."""
    heard(lambda: [one.operator for one in PrintHistory().entries()] == operators)


def test_a_name_given_after_the_end_is_found_and_stays_with_its_print(tmp_path: Path) -> None:
    records, folder = Records(tmp_path / "records"), tmp_path / "print"
    folder.mkdir()
    begun(folder, 1e9)
    PrintHistory().note(folder)
    record = records.current("file~a.gcode")
    records.mark(record, "Ada", started=1e9 + 1, folder=str(folder), ended=1e9 + 2)
    records.change(record, "Ada", {"operator": "Ada"})
    until_filed(["Ada"])
    journal = begun(folder, 2e9)  # the command line prints it once more
    PrintHistory().note(folder)
    records.change(record, "Ada", {"cells": "HUVEC"})
    until_filed(["", "Ada"])
    assert read_notes(journal) == {}
    beside = json.loads((folder / "record.1.json").read_text())
    assert beside["values"]["cells"] == "HUVEC"


# --- observer of a run's print that is started from the page, and of one that is gone on with
JOB = "run~observed"
RECIPE = {
    "schema": 1,
    "name": "observed",
    "tissue": {"shape": "block", "size_mm": [8, 8, 1]},
    "vasculature": {"grow": "tree", "terminals": 2, "smallest_diameter_mm": 0.2},
    "flow": {"viscosity_mpa_s": 1.0, "inlet_flow_ml_min": 0.05},
    "toolpath": {"method": "fresh", "needle": "28g"},
    "printer": {
        "profile": "generic_marlin",
        "port": "simulated",
        "syringe": "hamilton_1ml",
        "ink": "collagen_fresh",
        "bath": "gelatin_support",
    },
    "observe": {"device": "camera"},
}
CAMERA = {
    "camera": {"size_px": [200, 200], "um_per_px": 50, "target_mm": [50, 50, 1]},
    "laid": {"printer": "generic_marlin", "syringe": "hamilton_1ml", "ink": "collagen_fresh"},
}


SEES = """
import pathlib, sys, time
import numpy, PIL.Image
out = pathlib.Path(sys.argv[1])
while out.parent.name == "0002" and not pathlib.Path(__file__).with_name("works").exists():
    time.sleep(0.05)
noise = numpy.random.default_rng(time.monotonic_ns()).integers(124, 130, (200, 200))
PIL.Image.fromarray(noise.astype("u1")).save(out.with_suffix(".png"))
"""


@pytest.fixture
def order(core, tmp_path) -> ObserverOrder:
    """A run whose camera is a program that sees grey noise, and hangs in the second look."""
    folder = core.workspace.root / "runs" / "observed"
    folder.mkdir(parents=True)
    (folder / GCODE).write_bytes(layered(3, 20))
    manifest = Manifest(folder)
    manifest.facts = {"recipe": RECIPE}
    manifest.save()
    (tmp_path / "camera.yaml").write_text(yaml.safe_dump(CAMERA))
    (tmp_path / "see.py").write_text(SEES)
    words = f"{sys.executable} {tmp_path / 'see.py'} {{out}}"
    device = DeviceSettings("command", words, extra={"camera": str(tmp_path / "camera.yaml")})
    made = ObserverOrder(
        job=str(folder / GCODE),
        profile="generic_marlin",
        syringe="hamilton_1ml",
        ink="collagen_fresh",
        needle="28g",
        embedded=False,
        oct=False,
        frame="",
        device=device,
        limits=Limits(mend="tell"),
        care={"look_after": "layer", "look_limit_s": 8.0},
    )
    made.save(folder)
    return made


@pytest.mark.slow
def test_a_print_from_the_page_is_looked_at_and_after_a_resume_as_well(
    service, station, order, tmp_path
):
    folder = service.core.workspace.print_folder(JOB)
    service.start(OPERATOR, JOB, ready(service, JOB), WORDS)
    assert load_record(folder).care["look_after"] == MarkKind.LAYER
    heard((folder / "looks" / "0002").is_dir, 60.0)
    first = int((folder / READY_FILE).read_text())
    os.kill(first, signal.SIGKILL)
    held = until(service, JOB, LinkState.PAUSED)
    assert "nobody decided" in held.status.message
    (tmp_path / "works").touch()
    service.hands.resume(OPERATOR, JOB, ResumeRequest())
    assert int((folder / READY_FILE).read_text()) != first
    assert until(service, JOB, LinkState.DONE).status.alarms == 1
    looks = [(one.number, one.done, one.decision) for one in read_looks(folder)]
    assert looks == [(1, 27, "go_on"), (3, 51, "go_on"), (4, 75, "go_on")], "each layer's end"


@pytest.mark.slow
def test_nothing_moves_where_the_observer_cannot_be_started(service, station, order):
    folder = service.core.workspace.root / "runs" / "observed"
    broken = replace(order.device, source="/nowhere/look {out}")
    replace(order, device=broken).save(folder)
    said = ready(service, JOB)
    with pytest.raises(ObserverError, match=r"/nowhere/look isn't there.*Nothing was moved"):
        service.start(OPERATOR, JOB, said, WORDS)
    assert service.prints.heard(JOB) is None


def test_nothing_moves_where_nobody_says_how_to_observe(service, station, order):
    said = ready(service, JOB)
    (service.core.workspace.root / "runs" / "observed" / ORDER_FILE).unlink()
    with pytest.raises(SafetyError, match="make the run anew"):
        service.start(OPERATOR, JOB, said, WORDS)
    assert service.prints.heard(JOB) is None


# --- killed print process: page, API and command line agree, and the print continues
SPEED = 8.0


@pytest.fixture
def port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    start = ",".join(f"{mm:g}" for mm in START)
    folder = tmp_path_factory.mktemp("printer")
    with printer_process(folder, "--start", start, speed=SPEED) as name:
        yield name


@pytest.fixture
def behind(core, port) -> Iterator[Station]:
    """A station whose printer outlives it."""
    opened = connect("generic_marlin", port, core.workspace.station)
    opened.set_position(*START)
    opened.mount(**MOUNTED)
    yield opened
    if opened.status.open:
        shut(opened)


def started(service: JobService, port: str, layers: int = 6) -> str:
    job = add(service, layers=layers)
    said = ready(service, job).model_copy(update={"dish": "none"})
    service.start(OPERATOR, job, said, f"generic_marlin on {port}")
    until_so(service, job, lambda heard: heard.status.lines_executed > 40 and heard.progress)
    return job


def until_so(service: JobService, job: str, so):
    def told() -> Any:
        now = service.prints.heard(job)
        return now if now is not None and so(now) else None

    return heard(told, 60.0, lambda: service.prints.heard(job))


def ended_as(*states: LinkState):
    return lambda heard: heard.status.state in states


def broken_off(core, service: JobService, port: str):
    """Start a print and kill its station; return the job and what is heard of it."""
    job = started(service, port)
    os.kill(load_station(core.workspace.station).pid, signal.SIGKILL)
    return job, until_so(service, job, ended_as(LinkState.INTERRUPTED))


def everywhere(core, service: JobService, job: str) -> dict[str, dict]:
    """What each door tells of a print."""
    folder = core.workspace.print_folder(job)
    said = CliRunner().invoke(app, ["status", str(folder), "--json"])
    assert said.exit_code == 0, said.output
    heard = service.prints.heard(job)
    assert heard is not None
    return {
        "page": core.events.latest["print"],
        "api": heard.to_dict(),
        "command": json.loads(said.output),
    }


KEYS = ("state", "message", "lines_done", "lines_executed", "share", "words", "actions")


def assert_agree(core, service: JobService, job: str) -> None:
    """All doors tell the same; a killed process' locks go one by one, so after a while."""

    def agreed() -> Any:
        told = everywhere(core, service, job)
        return told if all(one[k] == told["page"][k] for k in KEYS for one in told.values()) else {}

    told = heard(agreed, told=lambda: everywhere(core, service, job))
    folder = core.workspace.print_folder(job)
    found = HistoryService(core).find(HistoryQuery()).entries
    entry = next(one for one in found if one.journal.parent == folder.resolve())
    assert entry.state == told["page"]["state"]
    assert entry.done == told["page"]["lines_done"]
    assert read_journal(folder / JOURNAL).done == told["page"]["lines_done"]


@pytest.mark.slow
def test_killed_station_leaves_a_print_that_the_page_goes_on_with(core, service, port, behind):
    job, broken = broken_off(core, service, port)
    assert 0 < broken.share < 1
    assert broken.time_left_s is None
    assert broken.may(PrintAction.GO_ON).possible
    assert "Go on" in broken.status.message
    assert_agree(core, service, job)
    service.hands.go_on(OPERATOR, job)
    assert service.hands.go_on(OPERATOR, job).state is not LinkState.INTERRUPTED
    done = until_so(service, job, lambda heard: heard.status.ended)
    assert done.status.state is LinkState.DONE, done.status.message
    assert_agree(core, service, job)


def test_the_simulated_printer_outlives_its_link_so_that_going_on_can_be_practised(core, service):
    station = connect("generic_marlin", "simulated", core.workspace.station, sim_speed=SPEED)
    station.set_position(*START)
    station.mount(**MOUNTED)
    job = started(service, "simulated")
    before = load_record(core.workspace.print_folder(job))
    os.kill(load_station(core.workspace.station).pid, signal.SIGKILL)
    broken = until_so(service, job, ended_as(LinkState.INTERRUPTED))
    assert broken.may(PrintAction.GO_ON).possible, broken.may(PrintAction.GO_ON).reason
    service.hands.go_on(OPERATOR, job)
    done = until_so(service, job, lambda heard: heard.status.ended)
    assert done.status.state is LinkState.DONE, done.status.message
    after = load_record(core.workspace.print_folder(job))
    assert was_simulated(core.workspace.print_folder(job))
    assert (before.port, after.print_id) == ("simulated", before.print_id)
    # Its record is of one printer, from the first move to the last.
    motion = ExecutedMotion.load(record_for(core.workspace.print_folder(job)))
    assert motion.line.min() < 40 < motion.line.max()


@pytest.mark.slow
def test_a_print_that_was_broken_off_is_given_up_and_its_end_is_told_by_all(
    core, service, port, behind
):
    job, _ = broken_off(core, service, port)
    assert service.hands.give_up(OPERATOR, job).state is LinkState.GIVEN_UP
    said = service.hands.give_up(OPERATOR, job).message
    assert said.startswith("given up by Ada")
    assert "settings may be the job's still, send M" in said
    given_up = until_so(service, job, ended_as(LinkState.GIVEN_UP))
    assert not given_up.may(PrintAction.GO_ON).possible
    with pytest.raises(Refused, match="given_up"):
        service.hands.go_on(OPERATOR, job)
    heard(lambda: core.events.latest["print"]["state"] == "given_up")
    assert_agree(core, service, job)


@pytest.mark.slow
def test_a_printer_that_was_connected_anew_isnt_gone_on_with_but_recovered(
    core, service, port, behind
):
    job, _ = broken_off(core, service, port)
    again = connect("generic_marlin", port, core.workspace.station, discard_interrupted=True)
    try:
        broken = until_so(service, job, lambda heard: not heard.may(PrintAction.GO_ON).possible)
        assert "connected anew" in broken.may(PrintAction.GO_ON).reason
        with pytest.raises(Refused, match="connected anew"):
            service.hands.go_on(OPERATOR, job)
        assert broken.may(PrintAction.RECOVER).possible
        line = 40 if broken.may(PrintAction.RECOVER).needs else None
        rest = service.hands.recover(OPERATOR, job, RecoverRequest(from_line=line))
        assert entry_of(core.workspace, rest.job).name == "zigzag.rest.gcode"
        assert "straight up" in rest.steps[0]
    finally:
        shut(again)


def test_a_new_server_tells_of_the_print_that_broke_off(core, service, port, behind):
    job = started(service, port)
    service.close()
    os.kill(load_station(core.workspace.station).pid, signal.SIGKILL)
    core.events.latest.clear()
    again = JobService(core)
    try:
        heard(lambda: "print" in core.events.latest)
        assert core.events.latest["print"]["state"] == "interrupted"
        found = again.prints.current()
        assert found is not None
        assert found.job == job
        assert_agree(core, again, job)
    finally:
        again.close()


@pytest.mark.slow
def test_a_killed_link_process_of_its_own_is_gone_on_with_after_a_go_on(
    core, service, port, behind
):
    """After the first go-on the print has a link process of its own; it is killed as well."""
    job, _ = broken_off(core, service, port)
    before = service.hands.go_on(OPERATOR, job).lines_done
    until_so(service, job, lambda heard: heard.status.lines_executed > before + 20)
    os.kill(load_record(core.workspace.print_folder(job)).pid, signal.SIGKILL)
    until_so(service, job, ended_as(LinkState.INTERRUPTED))
    assert_agree(core, service, job)
    service.hands.resume(OPERATOR, job, ResumeRequest())  # as `printctl resume` does
    done = until_so(service, job, lambda heard: heard.status.ended)
    assert done.status.state is LinkState.DONE, done.status.message
