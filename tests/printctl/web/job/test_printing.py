"""A print on the real simulated printer, through the station."""

from __future__ import annotations

import errno
import json
import logging
import os
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from printctl.errors import SafetyError
from printctl.machine.link import LinkState
from printctl.machine.link.history import PrintHistory
from printctl.machine.link.journal import Journal
from printctl.machine.link.marks import MarkKind
from printctl.machine.link.print_notes import read_notes
from printctl.machine.link.record import JOURNAL, LinkRecord, load_record
from printctl.machine.link.states import Status
from printctl.observe.deciding import Limits
from printctl.observe.devices import DeviceSettings
from printctl.observe.order import ObserverOrder
from printctl.observe.records import ORDER, READY, read_looks
from printctl.observe.starting import ObserverError
from printctl.run_folder.artefacts import GCODE
from printctl.run_folder.manifest import Manifest
from printctl.web.errors import ConflictError, NotInControlError
from printctl.web.job.record import Records
from printctl.web.job.service import JobService
from tests.printctl.machine.link.layered import layered
from tests.printctl.machine.link.test_journal import begun
from tests.printctl.web.job.camera.pictures import until as heard
from tests.printctl.web.job.conftest import OPERATOR, OTHER, add, ready

WORDS = "generic_marlin on simulated"


def until(service: JobService, job: str, *states: LinkState):
    limit = time.monotonic() + 60
    while time.monotonic() < limit:
        heard = service.heard(job)
        if heard is not None and heard.status.state in states:
            return heard
        time.sleep(0.02)
    raise AssertionError(f"never {states}: {service.heard(job)}")


def test_a_print_is_started_held_gone_on_with_and_done(service, station):
    job = add(service)
    said = ready(service, job)
    assert said.needle == "28g"
    assert said.start_mm == (50.0, 50.0, 10.0)
    begun = service.start(OPERATOR, job, said, WORDS)
    assert service.start(OPERATOR, job, said, WORDS).journal.started == begun.journal.started
    service.hands.pause(OPERATOR, job, "layer")
    service.hands.pause(OPERATOR, job, "layer")
    held = until(service, job, LinkState.PAUSED)
    assert held.progress is not None
    assert 0 < held.progress.share < 1
    assert held.progress.layers == 6
    service.hands.resume(OPERATOR, job)
    service.hands.resume(OPERATOR, job)
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
    with pytest.raises(ConflictError, match="who prints"):  # a new print has a record of its own
        service.start(OPERATOR, job, said, WORDS)


def test_a_job_is_cancelled_and_printed_again_on_the_same_station(core, service, station):
    """Both prints have the station's process; the second one is paused, and tells so itself."""
    job = add(service)
    first = service.start(OPERATOR, job, ready(service, job), WORDS)
    service.hands.cancel(job)
    until(service, job, LinkState.STOPPED)
    heard(lambda: service.machine().ready)
    service.to_start(OPERATOR, job, (50.0, 50.0, 10.0))
    second = service.start(OPERATOR, job, ready(service, job), WORDS)
    assert not second.status.ended
    assert second.journal.print_id != first.journal.print_id
    service.hands.pause(OPERATOR, job, "now")
    heard(lambda: core.events.latest["print"]["state"] == "paused")
    assert core.events.latest["print"]["print_id"] == second.journal.print_id
    service.hands.cancel(job)
    until(service, job, LinkState.STOPPED)
    records = [service.records.load(one) for one in service.records.of_job(job)]
    identities = [first.journal.print_id, second.journal.print_id]
    assert [one["print_id"] for one in records] == identities
    assert [one["state"] for one in records] == ["stopped", "stopped"]


@pytest.mark.slow
def test_a_new_server_finds_the_print_that_goes_on(core, service, station):
    job = add(service)
    service.start(OPERATOR, job, ready(service, job), WORDS)
    service.close()
    again = JobService(core)
    try:
        found = until(again, job, LinkState.PRINTING)
        assert again.current() is not None
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
    folder, prints = service.core.workspace.print_folder(job), service._prints
    written, before = load_record(folder), service._prints._followers[job]
    replace(written, status={}, address="still here").save(folder)
    prints.follow(job, folder)
    assert prints._followers[job] is before
    replace(written, status={}, session="another").save(folder)
    prints.follow(job, folder)
    assert prints._followers[job] is not before


def test_a_start_wants_name_list_machine_and_controls(service, station):
    job = add(service)
    said = service.set_up(job)
    with pytest.raises(ConflictError, match="operator's name"):
        service.start(OPERATOR, job, said, WORDS)
    service.write_down(OPERATOR, job, {"operator": "Ada"})
    with pytest.raises(ConflictError, match="points of the list"):
        service.start(OPERATOR, job, said, WORDS)
    ready(service, job)
    with pytest.raises(ConflictError, match="confirm that one"):
        service.start(OPERATOR, job, said, "another on /dev/ttyUSB0")
    with pytest.raises(NotInControlError):
        service.start(OTHER, job, said, WORDS)
    other = said.model_copy(update={"needle": "30g"})
    with pytest.raises(SafetyError, match="28g is mounted, and 30g was checked"):
        service.start(OPERATOR, job, other, WORDS)
    away = said.model_copy(update={"start_mm": (60.0, 50.0, 10.0)})
    with pytest.raises(SafetyError, match=r"tip's distance from the start: 10 mm, limit 0\.05"):
        service.start(OPERATOR, job, away, WORDS)
    assert service.heard(job) is None


# --- print on a full disk: state reported, end recorded later
def ended(service: JobService) -> tuple[str, str]:
    """Leave a print that is over and whose end isn't noted; give its job and record."""
    job = add(service)
    folder = service.core.workspace.print_folder(job)
    folder.mkdir(parents=True)
    journal = Journal(folder / JOURNAL)
    journal.add("job", name=job, path="", sha256="", lines=1, started=time.time())
    journal.close()
    status = Status(LinkState.DONE).to_dict()
    LinkRecord(0, "", "", "", "generic_marlin", "p", time.time(), status=status).save(folder)
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
            heard = service.heard(job)
            assert heard is not None
            assert heard.status.state is LinkState.DONE
    assert len([one for one in caplog.records if "can't be noted" in one.message]) == 1
    space_came = time.time()
    monkeypatch.setattr(service.records, "mark", write)
    service.heard(job)
    kept = service.records.load(record)
    assert kept["state"] == "done"
    assert kept["ended"] < space_came


# --- notes made after a print's end: in the history, with their print
@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))


def until_filed(operators: list[str]) -> None:
    """The history is told in a thread of its own."""
    limit = time.monotonic() + 20.0
    while [one.operator for one in PrintHistory().entries()] != operators:
        assert time.monotonic() < limit, PrintHistory().entries()
        time.sleep(0.05)


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


COPIES = """
import pathlib, shutil, sys, time
here, out = pathlib.Path(__file__).parent, pathlib.Path(sys.argv[1])
while out.parent.name == "0002" and not (here / "works").exists():
    time.sleep(0.05)
shutil.copy(here / f"grey{out.parent.name}.png", out.with_suffix(".png"))
"""


@pytest.fixture
def order(core, tmp_path) -> ObserverOrder:
    """A run whose camera is a program that copies grey pictures, and hangs in the second look."""
    folder = core.workspace.root / "runs" / "observed"
    folder.mkdir(parents=True)
    (folder / GCODE).write_bytes(layered(3, 20))
    manifest = Manifest(folder)
    manifest.facts = {"recipe": RECIPE}
    manifest.save()
    for look in range(4):
        grey = np.full((200, 200), 126 + look, np.uint8)
        cv2.imwrite(str(tmp_path / f"grey{look:04d}.png"), grey)
    (tmp_path / "camera.yaml").write_text(yaml.safe_dump(CAMERA))
    (tmp_path / "copy.py").write_text(COPIES)
    words = f"{sys.executable} {tmp_path / 'copy.py'} {{out}}"
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
    while not (folder / "looks" / "0002").is_dir():
        time.sleep(0.02)
    first = int((folder / READY).read_text())
    os.kill(first, signal.SIGKILL)
    held = until(service, JOB, LinkState.PAUSED)
    assert "nobody decided" in held.status.message
    (tmp_path / "works").touch()
    service.hands.resume(OPERATOR, JOB)
    assert int((folder / READY).read_text()) != first
    assert until(service, JOB, LinkState.DONE).status.alarms == 1
    assert [(one.number, one.decision) for one in read_looks(folder)] == [
        (1, "go_on"),
        (3, "go_on"),
    ]


@pytest.mark.slow
def test_nothing_moves_where_the_observer_cannot_be_started(service, station, order):
    folder = service.core.workspace.root / "runs" / "observed"
    broken = replace(order.device, source="/nowhere/look {out}")
    replace(order, device=broken).save(folder)
    said = ready(service, JOB)
    with pytest.raises(ObserverError, match=r"/nowhere/look isn't there.*Nothing was moved"):
        service.start(OPERATOR, JOB, said, WORDS)
    assert service.heard(JOB) is None


def test_nothing_moves_where_nobody_says_how_to_observe(service, station, order):
    said = ready(service, JOB)
    (service.core.workspace.root / "runs" / "observed" / ORDER).unlink()
    with pytest.raises(ConflictError, match="make the run anew"):
        service.start(OPERATOR, JOB, said, WORDS)
    assert service.heard(JOB) is None
