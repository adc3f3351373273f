"""A print on the real simulated printer, through the station."""

from __future__ import annotations

import json
import time
from dataclasses import replace

import pytest

from printctl.errors import SafetyError
from printctl.machine.link import LinkState
from printctl.machine.link.record import load_record
from printctl.web.errors import ConflictError, NotInControlError
from printctl.web.job.service import JobService
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
