"""Prints over REST: told apart by their own identity."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from printctl.machine.link.states import LinkState, Status
from printctl.machine.print_state.state import PrintTruth
from printctl.machine.printing.journal_facts import JournalledFacts
from printctl.machine.station import connect
from printctl.web.job.following import PrintFollower, PrintReport
from printctl.web.job.service import JobService
from tests.printctl.machine.link.layered import layered
from tests.printctl.web.job.conftest import START, shut
from tests.printctl.web.serving import served
from tests.waiting import wait_for

WORDS = "generic_marlin on simulated"


def test_a_job_cancelled_and_started_again_is_told_as_another_print(tmp_path: Path) -> None:
    app = served(tmp_path)
    station = connect(
        "generic_marlin", "simulated", app.core.workspace.station, sim_speed=20.0, start_mm=START
    )
    station.mount(
        syringe="hamilton_1ml", ink="collagen_fresh", needle="28g", bath="gelatin_support"
    )
    headers = {"Authorization": f"Bearer {app.access.token}"}
    try:
        with app.client() as client:

            def call(method: str, path: str, **more: Any) -> Any:
                answer = client.request(method, f"/api/v1{path}", headers=headers, **more)
                assert answer.status_code < 300, answer.text
                return answer.json()

            assert call("GET", "/prints/current") is None
            job = call("POST", "/jobs", files={"file": ("part.gcode", layered(6, 60))})["id"]
            assert call("GET", f"/prints/current?job={job}") is None
            points = {one["id"]: True for one in call("GET", f"/jobs/{job}/form")["checklist"]}

            def start() -> Any:
                values = {"operator": "Ada", "ticked": points}
                call("PATCH", f"/jobs/{job}/record", json=values)
                return call("POST", f"/prints/{job}/start", json={"confirmed": WORDS})

            first = start()
            call("POST", f"/prints/{job}/cancel")
            ended = wait_for(
                lambda: (one := call("GET", f"/prints/{job}"))["state"] == "stopped" and one
            )
            assert ended["print_id"] == first["print_id"]
            assert ended["alert"]["what"] == "The print was cancelled"
            wait_for(lambda: call("GET", f"/jobs/{job}/form")["machine"]["ready"])
            call("POST", f"/jobs/{job}/to-start", json={})
            second = start()
            assert second["print_id"] != first["print_id"]
            for path in (f"/prints/{job}", "/prints/current", f"/prints/current?job={job}"):
                print_ = call("GET", path)
                assert print_["print_id"] == second["print_id"]
                assert not print_["ended"]
                assert print_["alert"] is None
            possible = {one["action"] for one in print_["actions"] if one["possible"]}
            assert {"pause", "stop"} <= possible
            wait_for(lambda: app.core.events.latest["print"]["print_id"] == second["print_id"])
            call("POST", f"/prints/{job}/cancel")
            wait_for(lambda: call("GET", f"/prints/{job}")["state"] == "stopped")
    finally:
        shut(station)


def test_a_table_that_is_made_late_does_not_speak_over_the_next_print(
    service: JobService, monkeypatch: Any
) -> None:
    """That of a long job takes minutes: its print may have ended, and the next one begun."""
    told: list[str] = []
    prints = service._prints
    monkeypatch.setattr(prints, "_tell", lambda heard: told.append(heard.truth.journal.print_id))
    old, new = (_follower(prints._workspace.root) for _ in range(2))
    monkeypatch.setitem(prints._followers, "file~part.gcode", new)
    prints._hear(_report("first"), old)
    prints._hear(_report("second"), new)
    assert told == ["second"]


def _follower(folder: Path) -> PrintFollower:
    return PrintFollower("file~part.gcode", folder, lambda: None, lambda heard: None)


def _report(print_id: str) -> PrintReport:
    journal = JournalledFacts(print_id, "ab", time.time())
    return PrintReport("file~part.gcode", PrintTruth(Path(), Status(LinkState.PRINTING), journal))
