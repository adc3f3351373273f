"""Manual moves, heaters, plunger, calibrations by REST, with a simulated printer."""

from __future__ import annotations

import errno
import io
import math
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firmware_profiles import Dish, Ink, Needle, Printer, Syringe, load
from printctl.machine.control.idle.station_status import StationState, StationStatus
from printctl.machine.process.clients import starting
from printctl.machine.process.clients.client import attach_station
from printctl.machine.process.clients.starting import connect
from printctl.web.printer import following
from printctl.web.printer.part_change import PURGE_STEP_UL, PURGE_UL
from printctl.web.printer.service import PrinterService
from printctl.web.printer.status import BLIND_LIFT_MM, CLEAR_MM
from printctl.web.workspace import Workspace
from tests import waiting
from tests.printctl.machine.link.layered import layered
from tests.printctl.web.printer.conftest import Script, wait_for
from tests.printctl.web.serving import served

IN_DISH = {"needle": "25g", "dish": "petri_60mm"}


def touched_off(api: Script, surface: str = "floor") -> Any:
    """Take three readings where the tip is, and use them."""
    api.do("touch-off", surface=surface)
    for _ in range(3):
        api.do("touch-off/reading")
    return api.do("touch-off/use")


def test_status_ports_and_profiles_are_told(api: Script) -> None:
    status = api.get("status")
    assert status["state"] == "ready"
    assert status["state_words"].startswith("ready: connected, checked")
    assert status["printer"] == "generic_marlin"
    assert status["position_mm"] == [0.0, 0.0, 0.0]
    assert isinstance(api.get("ports"), list)
    names = [one["name"] for one in api.get("profiles")]
    assert "generic_marlin" in names
    assert "aerotech_pneumatic" not in names  # takes no lines from a host


def test_status_adds_what_follows_from_the_parts(api: Script) -> None:
    assert api.get("status")["fastest_ul_s"] is None
    parts = {"needle": "", "syringe": "hamilton_1ml", "ink": "collagen_fresh"}
    status = api.do("mount", **parts)
    assert status["parts"] == {**parts, "dish": "", "bath": ""}
    assert status["fastest_ul_s"] == load(Ink, "collagen_fresh").plunger_ul_s
    assert status["full_ul"] == load(Syringe, "hamilton_1ml").volume_ul - 20.0


def test_parts_are_described_and_one_that_cannot_be_read_hides_no_other(
    idle: PrinterService, idle_api: Script
) -> None:
    bad = idle.store.folder(Needle) / "mine.yaml"
    bad.parent.mkdir(parents=True)
    bad.write_text("inner_mm: wide\n")
    parts = idle_api.get("parts")
    assert set(parts) == {"needle", "syringe", "ink", "dish", "bath"}
    needles = {one["name"]: one["about"] for one in parts["needle"]}
    assert needles["25g"].startswith("bore 0.26 mm")
    assert needles["mine"].startswith("can't be read")
    volumes = {one["name"]: one["volume_ul"] for one in parts["syringe"]}
    assert volumes["hamilton_1ml"] == 1000.0


def test_without_a_printer_every_request_is_a_conflict(idle_api: Script) -> None:
    for path, body in (
        ("jog", {"axis": "x", "mm": 1}),
        ("home", {"axes": ["x"]}),
        ("lift-out", {}),
        ("set-position", {"z": 1}),
        ("disconnect", {}),
        ("reconnect", {}),
        ("stop-motion", {}),
        ("heat", {"name": "bed", "celsius": 20}),
        ("plunger", {"ul": 1}),
        ("command", {"text": "M105"}),
        ("mount", {"needle": "25g"}),
        ("touch-off", {"surface": "floor"}),
        ("change/purge", {"ul": 1}),
    ):
        status, message = idle_api.refused(path, **body)
        assert status == 409, path
        assert "connect" in message, path


def test_a_second_printer_is_not_connected_over_the_first(api: Script) -> None:
    status, message = api.refused("connect", profile="marlin_avr", port="simulated")
    assert status == 409
    assert "disconnect it first" in message


def test_only_who_holds_the_controls_moves_but_anyone_stops(api: Script) -> None:
    api.do("jog", axis="x", mm=1)
    for path, body in (
        ("jog", {"axis": "x", "mm": 1}),
        ("heat", {"name": "bed", "celsius": 30}),
        ("plunger", {"ul": 1}),
        ("mount", {"needle": "25g"}),
        ("command", {"text": "M105"}),
        ("touch-off", {"surface": "floor"}),
        ("change/needle", {"needle": "25g"}),
        ("disconnect", None),
    ):
        answer = api.ask(path, body, who="office")
        assert answer.status_code == 423, path
        assert "me holds the controls" in answer.json()["message"]
    assert api.ask("stop-motion", who="office").status_code == 200


def test_out_of_the_bath_is_above_the_rim_where_that_is_known(api: Script) -> None:
    assert api.do("lift-out")["position_mm"][2] == pytest.approx(BLIND_LIFT_MM)
    api.do("home", axes=["z"])
    api.do("mount", **IN_DISH)
    touched_off(api)
    above = load(Dish, "petri_60mm").wall_mm + CLEAR_MM
    assert api.do("lift-out")["position_mm"][2] == pytest.approx(above)
    assert "already" in api.refused("lift-out")[1]


def test_homing_with_a_needle_above_a_dish_is_refused(api: Script) -> None:
    api.do("mount", **IN_DISH)
    assert "needle" in api.refused("home", axes=["z"])[1]
    assert api.do("home", axes=["z"], needle_off=True)["homed"][2]


def test_a_needle_put_on_is_not_trusted_until_somebody_says_where_its_tip_is(api: Script) -> None:
    api.do("home", axes=["x", "y", "z"], needle_off=True)
    api.do("jog", axis="z", mm=30)
    assert not api.do("mount", needle="30g")["position_trusted"]
    said = api.do("set-position", z=12.5)
    assert said["position_trusted"]
    assert said["position_mm"] == pytest.approx((0.0, 0.0, 12.5))
    assert "200 mm" in api.refused("set-position", z=500)[1]


def test_targets_keep_within_what_the_ink_bears_and_all_go_off(
    service: PrinterService, api: Script
) -> None:
    def targets() -> list[float | None]:
        return [one.target_c for one in service.status.temperatures]

    api.do("mount", ink="collagen_fresh")
    assert "temperature_c" in api.refused("heat", name="nozzle", celsius=60)[1]
    api.do("heat", name="bed", celsius=30)
    wait_for(service, lambda: targets() == [0.0, 30.0])
    api.do("heaters-off")
    wait_for(service, lambda: targets() == [0.0, 0.0])
    assert set(api.get("temperatures")["now_c"]) == {"nozzle", "bed"}


def test_refusals_have_a_status_and_say_why(api: Script) -> None:
    status, message = api.refused("jog", axis="x", mm=-20)
    assert status == 409
    assert "outside 0 to 200 mm" in message
    assert api.refused("jog", axis="e", mm=1)[0] == 422
    assert api.refused("jog", axis="x", mm=1, by=2)[0] == 422
    assert api.refused("command", text="M105\nM112")[0] == 422
    assert api.refused("macros/run/none")[0] == 404
    assert api.refused("calibrations/none/job")[0] == 422
    nan = {"content": '{"axis": "x", "mm": NaN}', "headers": {"x-name": "me"}}
    assert api.client.post("/api/v1/printer/jog", **nan).status_code == 422


def test_a_full_disk_is_said_before_a_printer_is_connected(
    idle_api: Script, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Full(io.RawIOBase):
        def write(self, data: object) -> int:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(starting, "TemporaryFile", lambda **_: Full())
    answer = idle_api.ask("connect", {"profile": "generic_marlin", "port": "simulated"})
    assert answer.status_code == 507
    message = answer.json()["message"]
    assert message.startswith("the disk is full (")
    assert "free some space and do the same again" in message
    assert idle_api.get("status")["state"] == "closed"


def test_after_a_stop_nobody_knows_where_a_simulated_tip_stands_either(
    own_api: Script, tmp_path: Path
) -> None:
    assert own_api.get("status")["position_trusted"]
    own_api.do("mount", **IN_DISH)
    touched_off(own_api)
    attach_station(Workspace(tmp_path).station).kill()
    waiting.wait_for(lambda: own_api.get("status")["state"] == "halted", told=str)
    halted = own_api.get("status")["unknown"]
    assert set(halted) == {"position", "ink", "temperatures"}
    assert "motors may have lost steps" in halted["position"]
    status = own_api.do("reconnect")
    assert (status["state"], status["position_trusted"]) == ("ready", False)
    assert "X, Y, Z not homed since" in status["unknown"]["position"]
    told = waiting.wait_for(lambda: (one := own_api.get("status"))["temperatures"] and one)
    assert set(told["unknown"]) == {"position", "ink"}
    assert status["position_words"].endswith("no axis homed")
    assert status["mounted"]["floor_mm"] is None
    assert "at most 1 mm" in own_api.refused("jog", axis="z", mm=-2)[1]
    status = own_api.do("home", axes=["x", "y", "z"], needle_off=True)
    assert status["position_trusted"]
    assert set(status["unknown"]) == {"ink"}
    mounted = own_api.do("change/syringe", syringe="hamilton_1ml", filled_ul=500)
    assert mounted["unknown"] == {}


def test_the_tip_is_not_moved_to_a_start_above_a_floor_that_nobody_touched(
    tmp_path: Path,
) -> None:
    app = served(tmp_path)
    folder = app.core.workspace.station
    station = connect("generic_marlin", "simulated", folder, sim_speed=0.0, start_mm=(50, 50, 10))
    place = station.mount(needle="28g", dish="petri_60mm", dish_centre_mm=(60, 60))
    try:
        with app.client() as page:
            page.headers["Authorization"] = f"Bearer {app.access.token}"
            job = page.post("/api/v1/jobs", files={"file": ("part.gcode", layered(2, 20))}).json()
            start = {"start_mm": [55, 50, 10]}
            answer = page.post(f"/api/v1/jobs/{job['id']}/to-start", json=start)
        assert answer.status_code == 409
        assert "floor of petri_60mm isn't touched off" in answer.json()["message"]
        assert "Touch off the floor (Printer page" in answer.json()["message"]
        assert station.status.position_mm == place.position_mm
    finally:
        station.close()


# --- console and macros
def test_what_is_typed_is_answered_and_kept(api: Script) -> None:
    replies = api.do("command", text="M115")["replies"]
    assert any("FIRMWARE_NAME" in line for line in replies)
    assert "M112" in api.refused("command", text="M112")[1]
    kept = api.get("console")
    assert [one["text"] for one in kept[-2:]] == ["M115", "M112"]
    assert "M112" in kept[-1]["refused"]
    assert api.get(f"console?after={kept[-2]['number']}") == kept[-1:]


def test_a_macro_is_kept_run_and_removed(api: Script) -> None:
    macro = {"name": "where", "commands": ["M114"]}
    kept = api.ask("macros/generic_marlin", macro, do="PUT").json()
    assert kept["macros"] == [macro]
    assert "X:" in " ".join(api.do("macros/run/where")["replies"])
    assert api.ask("macros/generic_marlin/where", do="DELETE").json()["macros"] == []
    assert api.ask("macros/generic_marlin/where", do="DELETE").status_code == 404
    assert api.ask("macros/..%2F..%2Fetc", do="GET").status_code in (404, 422)


def test_a_macro_holds_nothing_that_the_console_refuses(idle_api: Script) -> None:
    bad = {"name": "halt", "commands": ["M105", "M112"]}
    answer = idle_api.ask("macros/generic_marlin", bad, do="PUT")
    assert (answer.status_code, "line 2: M112" in answer.json()["message"]) == (422, True)
    assert idle_api.get("macros/generic_marlin") == {"macros": []}


def test_a_macro_that_was_smuggled_into_the_file_is_not_run(
    service: PrinterService, api: Script
) -> None:
    path = service.core.workspace.private / "macros" / "generic_marlin.yaml"
    path.parent.mkdir(exist_ok=True)
    path.write_text("macros: [{name: bad, commands: [M105, G91]}]")
    assert "G91" in api.refused("macros/run/bad")[1]
    assert api.get("console") == []
    path.unlink()


# --- syringe or needle change
def test_more_than_a_syringe_holds_is_refused(api: Script) -> None:
    status, message = api.refused("change/syringe", syringe="hamilton_1ml", filled_ul=1500)
    assert (status, "1000" in message) == (422, True)


def test_a_purge_is_slow_small_and_limited_in_all(api: Script) -> None:
    full = {"syringe": "hamilton_1ml", "ink": "collagen_fresh", "filled_ul": 1000}
    before = api.do("change/syringe", **full)["ul_left"]
    assert "at most 5" in api.refused("change/purge", ul=20)[1]
    assert "at most at 0.4 µL/s" in api.refused("change/purge", ul=1, ul_s=4)[1]
    for _ in range(int(PURGE_UL / PURGE_STEP_UL)):
        status = api.do("change/purge", ul=PURGE_STEP_UL)
    assert status["ul_left"] == pytest.approx(before - PURGE_UL, abs=0.1)
    assert "clog" in api.refused("change/purge", ul=1)[1]
    api.do("change/syringe", **full)
    purged = api.do("change/purge", ul=1)
    pushed = api.do("plunger", ul=1, ul_s=0.3)
    assert purged["ul_left"] - pushed["ul_left"] == pytest.approx(1.0, abs=0.02)


def test_another_needle_forgets_floor_and_bath(api: Script) -> None:
    api.do("mount", **IN_DISH, bath_level_mm=9)
    touched_off(api)
    mounted = api.do("change/needle", needle="30g")["mounted"]
    assert (mounted["needle"], mounted["floor_mm"], mounted["bath_level_mm"]) == ("30g", None, None)


# --- touch-off: three readings must agree
def test_floor_is_the_middle_reading_less_the_foil(api: Script) -> None:
    assert api.do("mount", **IN_DISH)["needs_touch_off"]
    begun = api.do("touch-off", surface="floor", foil_mm=0.02)
    assert begun["touching"]["readings_mm"] == []
    api.do("jog", axis="z", mm=0.5)
    api.do("touch-off/reading")
    assert "1 of 3 readings" in api.refused("touch-off/use")[1]
    for step in (0.02, 0.02):
        api.do("jog", axis="z", mm=step)
        touching = api.do("touch-off/reading")["touching"]
    assert touching["agrees"]
    status = api.do("touch-off/use")
    assert status["mounted"]["floor_mm"] == pytest.approx(0.52 - 0.02, abs=1e-6)
    assert not status["needs_touch_off"]
    assert api.get("touch-off") == {"touching": None}


def test_readings_that_scatter_are_not_used(api: Script) -> None:
    api.do("mount", **IN_DISH)
    api.do("touch-off", surface="bath")
    for _ in range(3):
        api.do("jog", axis="z", mm=0.1)
        api.do("touch-off/reading")
    assert "don't agree" in api.refused("touch-off/use")[1]
    api.do("touch-off/reading")
    api.do("touch-off/reading")
    level = api.do("touch-off/use")["mounted"]["bath_level_mm"]
    assert level == pytest.approx(0.3, abs=1e-6)
    api.do("touch-off", surface="bath")
    assert api.ask("touch-off", do="DELETE").json() == {"touching": None}


# --- a station that was killed, followed: heard once, and looked for again after a while
GONE = StationStatus(StationState.LOST, "the station ended without a word")


class Dead:
    """What is attached to where a station was killed."""

    status = GONE
    heard = 0

    def events(self) -> Iterator[StationStatus]:
        Dead.heard += 1
        yield GONE

    def detach(self) -> None:
        """There is nothing to detach from."""


def test_a_dead_station_keeps_no_core_busy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its last word was read thousands of times a second, from a journal that grew."""
    elsewhere = following.attach_station  # servers of other tests may still follow theirs
    monkeypatch.setattr(
        following,
        "attach_station",
        lambda folder: Dead() if folder == tmp_path else elsewhere(folder),
    )
    monkeypatch.setattr(following, "LOOK_AGAIN_S", 60.0)
    told = threading.Event()
    follower = following.Follower(tmp_path, lambda status: told.set())
    try:
        assert told.wait(20)
        threading.Event().wait(0.3)
        assert follower.status is GONE
        assert Dead.heard == 1
    finally:
        follower.end()


# --- calibrations on the page: same results as the command line
WEIGHING = "steps per travel, if the bore is right"


def weighed(share: float) -> dict[str, object]:
    """Doses of a plunger whose steps give ``share`` of what they should."""
    area = load(Syringe, "hamilton_1ml").area_mm2
    rng = np.random.default_rng(1)
    doses = (20.0, 40.0, 60.0) * 4
    masses = [0.998 * ul * share + rng.normal(0, 0.02) for ul in doses]
    rows = [[f"{ul / area:.5f}", f"{m:.2f}"] for ul, m in zip(doses, masses, strict=True)]
    return {"rows": rows, "printer": "generic_marlin", "syringe": "hamilton_1ml"}


def test_a_test_lies_among_the_jobs_with_its_sheet(idle: PrinterService, idle_api: Script) -> None:
    listed = {one["name"] for one in idle_api.get("calibrations")}
    assert {"weigh", "level", "offset", "backlash"} <= listed
    where = {"printer": "generic_marlin", "syringe": "hamilton_1ml", "at_mm": [100, 100, 50]}
    made = idle_api.do("calibrations/weigh/job", **where)
    job = idle.core.workspace.job_file(made["job"])
    assert made["job"] in idle.core.workspace.jobs()
    assert made["job"].startswith("file~calibrate_weigh_")
    assert [row[-1] for row in made["rows"]] == [""] * 12
    sheet = job.with_suffix(".csv").read_text().splitlines()
    assert sheet[0].startswith("# printctl printer: Generic Marlin")
    assert sheet[1].startswith("# printctl syringe: Hamilton 1 mL")
    assert sheet[2] == "travel_mm,mass_mg"
    read = weighed(0.9) | {"job": made["job"], "syringe": "hamilton_5ml"}
    assert (
        "syringe that the job was made for" in idle_api.refused("calibrations/weigh/fit", **read)[1]
    )
    assert made["lines"] > 24


def test_a_test_that_preflight_refuses_is_not_written(
    idle: PrinterService, idle_api: Script
) -> None:
    outside = {"printer": "generic_marlin", "syringe": "hamilton_1ml", "axis": "x"}
    outside |= {"at_mm": [199, 100, 50]}
    assert "limit 200" in idle_api.refused("calibrations/backlash/job", **outside)[1]
    assert idle.core.workspace.jobs() == []


def test_weighing_finds_the_steps_and_writes_a_copy_that_can_be_connected(
    idle: PrinterService, idle_api: Script
) -> None:
    read = weighed(0.9)
    found = idle_api.do("calibrations/weigh/fit", **read)["estimates"][WEIGHING]
    steps = load(Printer, "generic_marlin").steps_per_mm.e
    assert found["low"] <= steps / 0.9 <= found["high"]
    idle_api.do("calibrations/weigh/profile", read=read, mend="printer", copy_name="bench_1")
    assert "bench_1" in idle.store.printers()
    copy = idle.store.load(Printer, "bench_1")
    assert copy.steps_per_mm.e == pytest.approx(steps / 0.9, rel=0.01)
    assert "measured by printctl calibrate" in copy.source
    idle_api.do("calibrations/weigh/profile", read=read, mend="syringe", copy_name="syringe_1")
    bore = idle.store.load(Syringe, "syringe_1").inner_mm
    assert bore == pytest.approx(load(Syringe, "hamilton_1ml").inner_mm * math.sqrt(0.9), rel=0.01)


def test_other_readings_are_fitted_or_refused(idle_api: Script) -> None:
    touches = [[name, "1", "2", z] for name in ("a", "b") for z in ("3.00", "3.01")]
    assert "b less a, z" in idle_api.do("calibrations/offset/fit", rows=touches)["estimates"]
    status, message = idle_api.refused("calibrations/offset/fit", rows=[["a", "1"]])
    assert (status, "each row has 4 columns" in message) == (422, True)
    assert idle_api.refused("calibrations/lag/fit", rows=touches)[0] == 409
    far = [["1e9", "1", "1"]] * 4
    assert "mend the row" in idle_api.refused("calibrations/backlash/fit", rows=far)[1]


def test_a_copy_does_not_take_a_shipped_name_or_leave_its_folder(
    idle_api: Script, tmp_path: Path
) -> None:
    before = sorted(tmp_path.rglob("*.yaml"))
    asked = {"read": weighed(0.9), "mend": "printer"}
    path = "calibrations/weigh/profile"
    assert "another" in idle_api.refused(path, **asked, copy_name="generic_marlin")[1]
    assert idle_api.refused(path, **asked, copy_name="../evil")[0] == 422
    assert sorted(tmp_path.rglob("*.yaml")) == before
