"""Killed print process: page, API and command line agree, and the print continues."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Iterator

import pytest
from typer.testing import CliRunner

from printctl.cli.main import app
from printctl.machine.link import LinkState
from printctl.machine.link.errors import Refused
from printctl.machine.link.history_query import HistoryQuery
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.record import JOURNAL, load_record
from printctl.machine.print_state.actions import PrintAction
from printctl.machine.station import Station, connect
from printctl.machine.station.record import load_station
from printctl.web.history.service import HistoryService
from printctl.web.job.service import JobService
from tests.printctl.web.job.conftest import OPERATOR, START, add, ready, shut
from tests.sim_process import printer_process

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
    opened.mount(syringe="hamilton_1ml", ink="collagen_fresh", needle="28g", bath="gelatin_support")
    yield opened
    if opened.status.open:
        shut(opened)


def started(service: JobService, port: str, layers: int = 6) -> str:
    job = add(service, layers=layers)
    service.start(OPERATOR, job, ready(service, job), f"generic_marlin on {port}")
    until(service, job, lambda heard: heard.status.lines_executed > 40 and heard.progress)
    return job


def until(service: JobService, job: str, so):
    limit = time.monotonic() + 60
    while time.monotonic() < limit:
        heard = service.heard(job)
        if heard is not None and so(heard):
            return heard
        time.sleep(0.02)
    raise AssertionError(f"never: {service.heard(job)}")


def ended(*states: LinkState):
    return lambda heard: heard.status.state in states


def everywhere(core, service: JobService, job: str) -> dict[str, dict]:
    """What each door tells of a print."""
    folder = core.workspace.print_folder(job)
    said = CliRunner().invoke(app, ["status", str(folder), "--json"])
    assert said.exit_code == 0, said.output
    heard = service.heard(job)
    assert heard is not None
    return {
        "page": core.events.latest["print"],
        "api": heard.to_dict(),
        "command": json.loads(said.output),
    }


KEYS = ("state", "message", "lines_done", "lines_executed", "share", "words", "actions")


def assert_agree(core, service: JobService, job: str) -> None:
    """All doors tell the same; a killed process' locks go one by one, so after a while."""
    limit = time.monotonic() + 20
    while True:
        told = everywhere(core, service, job)
        apart = [k for k in KEYS if any(one[k] != told["page"][k] for one in told.values())]
        if not apart or time.monotonic() > limit:
            break
        time.sleep(0.2)
    assert not apart, told
    folder = core.workspace.print_folder(job)
    found = HistoryService(core).find(HistoryQuery()).entries
    entry = next(one for one in found if one.journal.parent == folder.resolve())
    assert entry.state == told["page"]["state"]
    assert entry.done == told["page"]["lines_done"]
    assert read_journal(folder / JOURNAL).done == told["page"]["lines_done"]


@pytest.mark.slow
def test_killed_station_leaves_a_print_that_the_page_goes_on_with(core, service, port, behind):
    job = started(service, port)
    os.kill(load_station(core.workspace.station).pid, signal.SIGKILL)
    broken = until(service, job, ended(LinkState.INTERRUPTED))
    assert 0 < broken.truth.share < 1
    assert broken.truth.time_left_s is None
    assert broken.truth.may(PrintAction.GO_ON).possible
    assert "Go on" in broken.status.message
    assert_agree(core, service, job)
    service.hands.go_on(OPERATOR, job)
    assert service.hands.go_on(OPERATOR, job).state is not LinkState.INTERRUPTED
    done = until(service, job, lambda heard: heard.status.ended)
    assert done.status.state is LinkState.DONE, done.status.message
    assert_agree(core, service, job)


@pytest.mark.slow
def test_a_print_that_was_broken_off_is_given_up_and_its_end_is_told_by_all(
    core, service, port, behind
):
    job = started(service, port)
    os.kill(load_station(core.workspace.station).pid, signal.SIGKILL)
    until(service, job, ended(LinkState.INTERRUPTED))
    assert service.hands.give_up(OPERATOR, job).state is LinkState.GIVEN_UP
    said = service.hands.give_up(OPERATOR, job).message
    assert said.startswith("given up by Ada")
    assert "settings may be the job's still, send M" in said
    given_up = until(service, job, ended(LinkState.GIVEN_UP))
    assert not given_up.truth.may(PrintAction.GO_ON).possible
    with pytest.raises(Refused, match="given_up"):
        service.hands.go_on(OPERATOR, job)
    limit = time.monotonic() + 20
    while core.events.latest["print"]["state"] != "given_up" and time.monotonic() < limit:
        time.sleep(0.05)
    assert_agree(core, service, job)


@pytest.mark.slow
def test_a_printer_that_was_connected_anew_isnt_gone_on_with_but_recovered(
    core, service, port, behind
):
    job = started(service, port)
    os.kill(load_station(core.workspace.station).pid, signal.SIGKILL)
    until(service, job, ended(LinkState.INTERRUPTED))
    again = connect("generic_marlin", port, core.workspace.station, discard_interrupted=True)
    try:
        broken = until(service, job, lambda heard: not heard.truth.may(PrintAction.GO_ON).possible)
        assert "connected anew" in broken.truth.may(PrintAction.GO_ON).reason
        with pytest.raises(Refused, match="connected anew"):
            service.hands.go_on(OPERATOR, job)
        assert broken.truth.may(PrintAction.RECOVER).possible
        line = 40 if broken.truth.may(PrintAction.RECOVER).needs else None
        rest = service.hands.recover(OPERATOR, job, line)
        assert service.job(rest["job"]).name == "zigzag.rest.gcode"
        assert "straight up" in rest["steps"][0]
    finally:
        shut(again)


def test_a_new_server_tells_of_the_print_that_broke_off(core, service, port, behind):
    job = started(service, port)
    service.close()
    os.kill(load_station(core.workspace.station).pid, signal.SIGKILL)
    core.events.latest.clear()
    again = JobService(core)
    try:
        limit = time.monotonic() + 20
        while "print" not in core.events.latest and time.monotonic() < limit:
            time.sleep(0.05)
        assert core.events.latest["print"]["state"] == "interrupted"
        found = again.unfinished()
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
    job = started(service, port)
    os.kill(load_station(core.workspace.station).pid, signal.SIGKILL)
    until(service, job, ended(LinkState.INTERRUPTED))
    before = service.hands.go_on(OPERATOR, job).lines_done
    until(service, job, lambda heard: heard.status.lines_executed > before + 20)
    os.kill(load_record(core.workspace.print_folder(job)).pid, signal.SIGKILL)
    until(service, job, ended(LinkState.INTERRUPTED))
    assert_agree(core, service, job)
    service.hands.resume(OPERATOR, job)  # as `printctl resume` does
    done = until(service, job, lambda heard: heard.status.ended)
    assert done.status.state is LinkState.DONE, done.status.message
