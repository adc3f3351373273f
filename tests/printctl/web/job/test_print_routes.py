"""Prints over REST: told apart by their own identity."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from firmware_profiles.load import DATA
from printctl.machine.prints.state import read_print
from printctl.machine.process.clients.starting import connect
from printctl.machine.records.replay import JournalledPrint
from printctl.machine.records.states import LinkState, Status
from printctl.web.job.prints import PrintFollower, PrintReport
from printctl.web.job.service import JobService
from tests.printctl.machine.link.layered import layered
from tests.printctl.web.job.conftest import MOUNTED, START, WORDS, shut
from tests.printctl.web.serving import served
from tests.waiting import wait_for

Call = Callable[..., Any]


@pytest.fixture
def call(tmp_path: Path) -> Iterator[Call]:
    """Ask the API of a server with a quick printer, whose syringe is half empty."""
    app = served(tmp_path)
    station = connect(
        "generic_marlin", "simulated", app.core.workspace.station, sim_speed=20.0, start_mm=START
    )
    station.mount(**MOUNTED, plunger_mm=30.0)
    headers = {"Authorization": f"Bearer {app.access.token}"}

    def call(method: str, path: str, expected: int = 200, **more: Any) -> Any:
        answer = client.request(method, f"/api/v1{path}", headers=headers, **more)
        assert answer.status_code == expected, answer.text
        return answer.json()

    try:
        with app.client() as client:
            yield call
    finally:
        shut(station)


def uploaded(call: Call) -> str:
    job: str = call("POST", "/jobs", files={"file": ("part.gcode", layered(6, 60))})["id"]
    return job


def started(call: Call, job: str) -> Any:
    points = {one["id"]: True for one in call("GET", f"/jobs/{job}/form")["checklist"]}
    call("PATCH", f"/jobs/{job}/record", json={"operator": "Ada", "ticked": points})
    return call("POST", f"/prints/{job}/start", json={"confirmed": WORDS})


def cancelled(call: Call, job: str) -> Any:
    call("POST", f"/prints/{job}/cancel")
    ended = wait_for(lambda: (one := call("GET", f"/prints/{job}"))["state"] == "stopped" and one)
    wait_for(lambda: call("GET", f"/jobs/{job}/form")["machine"]["ready"])
    return ended


def test_a_job_cancelled_and_started_again_is_told_as_another_print(call: Call) -> None:
    assert call("GET", "/prints/current") is None
    job = uploaded(call)
    assert call("GET", f"/prints/current?job={job}") is None
    first = started(call, job)
    ended = cancelled(call, job)
    assert ended["print_id"] == first["print_id"]
    assert ended["alert"]["what"] == "The print was cancelled"
    call("POST", f"/jobs/{job}/to-start", json={})
    second = started(call, job)
    assert second["print_id"] != first["print_id"]
    for path in (f"/prints/{job}", "/prints/current", f"/prints/current?job={job}"):
        print_ = call("GET", path)
        assert print_["print_id"] == second["print_id"]
        assert not print_["ended"]
        assert print_["alert"] is None
    possible = {one["action"] for one in print_["actions"] if one["possible"]}
    assert {"pause", "stop"} <= possible
    call("POST", f"/prints/{job}/pause", json={})  # the second one tells so itself
    wait_for(lambda: call("GET", f"/prints/{job}")["state"] == "paused")
    cancelled(call, job)
    for one in (first, second):
        note = call("GET", f"/history/{one['print_id']}")["note"]
        assert note["state"] == "stopped"


def test_crossings_are_accepted_for_one_print(call: Call) -> None:
    job = uploaded(call)
    set_up = call("GET", f"/jobs/{job}/form")["set_up"]
    call("PUT", f"/jobs/{job}/set-up", json={**set_up, "accept_crossings": True})
    started(call, job)
    assert not call("GET", f"/jobs/{job}/form")["set_up"]["accept_crossings"]
    cancelled(call, job)


def test_ink_left_is_what_the_printer_knew_and_what_is_put_in_then(
    call: Call, tmp_path: Path
) -> None:
    job = uploaded(call)
    before_ul = call("GET", f"/jobs/{job}/form")["machine"]["ul_left"]
    started(call, job)
    made = wait_for(lambda: (one := call("GET", f"/prints/{job}")["progress"]) and one)
    assert made["ink_left_ul"] == pytest.approx(before_ul - made["ink_ul"], abs=1.0)
    call("POST", f"/prints/{job}/reload", json={"head": None})
    wait_for(lambda: call("GET", f"/prints/{job}")["waits_for"] == "syringe")
    resume = f"/prints/{job}/resume"
    refused = call("POST", resume, expected=409, json={"syringe": "hamilton_2_5ml"})
    assert "(hamilton_2_5ml) has a bore of 7.28 mm" in refused["message"]
    assert "(hamilton_1ml) of 4.61 mm" in refused["message"]
    outside = {"syringe": f"{tmp_path.parent}/half.yaml", "plunger_mm": 0}
    refused = call("POST", resume, expected=422, json=outside)
    assert "is a file outside the workspace" in refused["message"]
    assert call("GET", f"/prints/{job}")["waits_for"] == "syringe"
    half = tmp_path / "profiles" / "syringes" / "half.yaml"  # another volume in the same bore
    half.parent.mkdir(parents=True)
    text = (DATA / "syringes" / "hamilton_1ml.yaml").read_text()
    half.write_text(text.replace("volume_ul: 1000", "volume_ul: 500", 1))
    assert "half" in {one["name"] for one in call("GET", "/printer/parts")["syringe"]}
    half.with_name("dead.yaml").write_text(text.replace("volume_ul: 1000", "volume_ul: 20", 1))
    refused = call("POST", resume, expected=409, json={"syringe": "dead", "plunger_mm": 0})
    assert "dead_volume_ul 20 isn't below volume_ul 20" in refused["message"]
    refused = call("POST", resume, expected=409, json={"syringe": "half", "plunger_mm": 30})
    assert "not resumed: lines" in refused["message"], "it has 28.7 mm when full"
    assert call("GET", f"/prints/{job}")["waits_for"] == "syringe"
    resumed = call("POST", resume, json={"syringe": "half", "plunger_mm": 0})
    assert "not resumed" not in resumed["message"]
    made = call("GET", f"/prints/{job}")["progress"]
    assert 450 < made["ink_left_ul"] <= 480  # 20 µL are its dead volume
    cancelled(call, job)


def test_figures_of_a_cancelled_print_are_the_same_on_its_page_and_in_the_history(
    call: Call,
) -> None:
    job = uploaded(call)
    started(call, job)
    wait_for(lambda: (call("GET", f"/prints/{job}")["progress"] or {}).get("ink_ul", 0.0) > 0.1)
    call("POST", f"/prints/{job}/pause", json={})
    wait_for(lambda: call("GET", f"/prints/{job}")["state"] == "paused")
    ended = cancelled(call, job)
    past = call("GET", f"/history/{ended['print_id']}")
    figures = ("active_s", "predicted_s", "ink_ul", "ink_total_ul", "layers_done")
    assert [past["progress"][one] for one in figures] == [ended["progress"][one] for one in figures]


def test_time_left_is_the_same_on_the_page_and_on_the_command_line(
    call: Call, tmp_path: Path
) -> None:
    job = call("POST", "/jobs", files={"file": ("part.gcode", layered(12, 60))})["id"]
    started(call, job)
    made = wait_for(
        lambda: (
            (one := call("GET", f"/prints/{job}")["progress"])
            and one["remaining_error_s"] is not None
            and one
        )
    )
    assert made["ratio"] < 0.5  # the simulated printer is quick
    call("POST", f"/prints/{job}/pause", json={})
    paused = wait_for(lambda: (one := call("GET", f"/prints/{job}"))["state"] == "paused" and one)
    truth = read_print(Path(paused["folder"]))
    assert truth.time_left_s == pytest.approx(paused["time_left_s"])
    assert truth.words["time"] == paused["words"]["time"]
    cancelled(call, job)


def test_a_table_that_is_made_late_does_not_speak_over_the_next_print(
    service: JobService, monkeypatch: Any
) -> None:
    """That of a long job takes minutes: its print may have ended, and the next one begun."""
    told: list[str] = []
    prints = service.prints
    monkeypatch.setattr(prints, "_tell", lambda heard: told.append(heard.journal.print_id))
    old, new = (_follower(prints._workspace.root) for _ in range(2))
    monkeypatch.setitem(prints._followers, "file~part.gcode", new)
    prints._hear(_report("first"), old)
    prints._hear(_report("second"), new)
    assert told == ["second"]


def _follower(folder: Path) -> PrintFollower:
    return PrintFollower("file~part.gcode", folder, lambda *_: None, lambda *_: None)


def _report(print_id: str) -> PrintReport:
    job = {"id": print_id, "sha256": "ab", "started": time.time()}
    journal = JournalledPrint(job, job)
    return PrintReport(Path(), Status(LinkState.PRINTING), journal, job="file~part.gcode")
