"""Manual moves, heaters, plunger and connection, with a simulated printer."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fastapi import FastAPI, Request
from fastapi.testclient import TestClient
from starlette.middleware.base import BaseHTTPMiddleware, RequestResponseEndpoint
from starlette.responses import Response

from firmware_profiles import Dish, Ink, Needle, Printer, Syringe, load
from printctl.machine.link.errors import Refused
from printctl.machine.station import StationState, StationStatus
from printctl.web.api import answer_errors
from printctl.web.controls import Principal
from printctl.web.errors import BadRequestError, ConflictError, NotInControlError
from printctl.web.printer import following
from printctl.web.printer.calibration import CalibrationRequest, Read
from printctl.web.printer.console import Macro
from printctl.web.printer.part_change import PURGE_STEP_UL, PURGE_UL
from printctl.web.printer.printer_commands import BLIND_LIFT_MM, CLEAR_MM
from printctl.web.printer.routes import router
from printctl.web.printer.service import PrinterService
from tests.printctl.web.printer.conftest import ME, OTHER, wait_for


def test_out_of_the_bath_is_above_the_rim_where_that_is_known(service: PrinterService) -> None:
    lifted = service.commands.lift_out(ME).position_mm
    assert lifted is not None
    assert lifted[2] == pytest.approx(BLIND_LIFT_MM)
    service.commands.home(ME, ["z"])
    service.commands.mount(ME, needle="25g", dish="petri_60mm")
    service.guide.start(ME, "floor")
    for _ in range(3):
        service.guide.read(ME)
    service.guide.use(ME)
    up = service.commands.lift_out(ME).position_mm
    assert up is not None
    assert up[2] == pytest.approx(load(Dish, "petri_60mm").wall_mm + CLEAR_MM)
    with pytest.raises(ConflictError, match="already"):
        service.commands.lift_out(ME)


def test_homing_with_a_needle_above_a_dish_is_refused(service: PrinterService) -> None:
    service.commands.mount(ME, needle="25g", dish="petri_60mm")
    with pytest.raises(Refused, match="needle"):
        service.commands.home(ME, ["z"])
    assert service.commands.home(ME, ["z"], needle_off=True).homed[2]


def test_a_needle_put_on_is_not_trusted_until_somebody_says_where_its_tip_is(
    service: PrinterService,
) -> None:
    service.commands.home(ME, ["x", "y", "z"], needle_off=True)
    service.commands.jog(ME, "z", 30.0)
    assert not service.commands.mount(ME, needle="30g").position_trusted
    said = service.commands.set_position(ME, z=12.5)
    assert said.position_trusted
    assert said.position_mm == pytest.approx((0.0, 0.0, 12.5))
    with pytest.raises(Refused, match="200 mm"):
        service.commands.set_position(ME, z=500.0)


def test_targets_keep_within_what_the_ink_bears_and_all_go_off(service: PrinterService) -> None:
    service.commands.mount(ME, ink="collagen_fresh")
    with pytest.raises(Refused, match="temperature_c"):
        service.commands.heat(ME, "nozzle", 60.0)
    service.commands.heat(ME, "bed", 30.0)
    wait_for(service, lambda: targets(service) == [0.0, 30.0])
    service.commands.heaters_off(ME)
    wait_for(service, lambda: targets(service) == [0.0, 0.0])


def targets(service: PrinterService) -> list[float | None]:
    return [one.target_c for one in service.status.temperatures]


def test_a_needle_above_a_dish_is_to_be_touched_off(service: PrinterService) -> None:
    assert not service.status.mounted.touch_off_due
    assert service.commands.mount(ME, needle="25g", dish="petri_60mm").mounted.touch_off_due


# --- console and macros of the Printer page
def test_a_macro_holds_nothing_that_the_console_refuses(idle: PrinterService) -> None:
    bad = Macro(name="halt", commands=("M105", "M112"))
    with pytest.raises(BadRequestError, match="line 2: M112"):
        idle.macros.save(ME, "generic_marlin", bad)
    assert idle.macros.of("generic_marlin") == []


def test_a_macro_that_was_smuggled_into_the_file_is_not_run(service: PrinterService) -> None:
    path = service.core.workspace.private / "macros" / "generic_marlin.yaml"
    path.parent.mkdir(exist_ok=True)
    path.write_text("macros: [{name: bad, commands: [M105, G91]}]")
    sent = len(service.console.entries())
    with pytest.raises(BadRequestError, match="G91"):
        service.macros.run(ME, "bad")
    assert len(service.console.entries()) == sent
    path.unlink()


# --- syringe or needle change on the Printer page
def test_more_than_a_syringe_holds_is_refused(service: PrinterService) -> None:
    with pytest.raises(BadRequestError, match="1000"):
        service.changing.syringe(ME, "hamilton_1ml", "", 1500.0)


def test_a_purge_is_slow_small_and_limited_in_all(service: PrinterService) -> None:
    before = service.changing.syringe(ME, "hamilton_1ml", "collagen_fresh", 1000.0).ul_left
    with pytest.raises(BadRequestError, match="at most 5"):
        service.changing.purge(ME, 20.0)
    with pytest.raises(BadRequestError, match=r"at most at 0\.4 µL/s"):
        service.changing.purge(ME, 1.0, 4.0)
    for _ in range(int(PURGE_UL / PURGE_STEP_UL)):
        status = service.changing.purge(ME, PURGE_STEP_UL)
    assert before is not None
    assert status.ul_left == pytest.approx(before - PURGE_UL, abs=0.1)
    with pytest.raises(ConflictError, match="clog"):
        service.changing.purge(ME, 1.0)
    service.changing.syringe(ME, "hamilton_1ml", "collagen_fresh", 1000.0)
    assert service.changing.purged_ul == 0


def test_another_needle_forgets_floor_and_bath(service: PrinterService) -> None:
    service.commands.mount(ME, needle="25g", dish="petri_60mm", bath_level_mm=9.0)
    service.guide.start(ME, "floor")
    for _ in range(3):
        service.guide.read(ME)
    service.guide.use(ME)
    status = service.changing.needle(ME, "30g")
    assert status.mounted.needle == "30g"
    assert status.mounted.floor_mm is None
    assert status.mounted.bath_level_mm is None


# --- touch-off: three readings must agree
def test_floor_is_the_middle_reading_less_the_foil(service: PrinterService) -> None:
    service.commands.mount(ME, needle="25g", dish="petri_60mm")
    service.guide.start(ME, "floor", foil_mm=0.02)
    service.commands.jog(ME, "z", 0.5)
    service.guide.read(ME)
    with pytest.raises(ConflictError, match="1 of 3 readings"):
        service.guide.use(ME)
    for step in (0.02, 0.02):
        service.commands.jog(ME, "z", step)
        touching = service.guide.read(ME)
    assert touching.agrees
    status = service.guide.use(ME)
    assert status.mounted.floor_mm == pytest.approx(0.52 - 0.02, abs=1e-6)
    assert service.guide.touching is None


def test_readings_that_scatter_are_not_used(service: PrinterService) -> None:
    service.commands.mount(ME, needle="25g", dish="petri_60mm")
    service.guide.start(ME, "bath")
    for _ in range(3):
        service.commands.jog(ME, "z", 0.1)
        service.guide.read(ME)
    with pytest.raises(ConflictError, match="don't agree"):
        service.guide.use(ME)
    service.guide.read(ME)
    service.guide.read(ME)
    status = service.guide.use(ME)
    assert status.mounted.bath_level_mm == pytest.approx(0.3, abs=1e-6)


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
    elsewhere = following.attach  # servers of other tests may still follow theirs
    monkeypatch.setattr(
        following, "attach", lambda folder: Dead() if folder == tmp_path else elsewhere(folder)
    )
    monkeypatch.setattr(following, "LOOK_AGAIN_S", 60.0)
    told = threading.Event()
    follower = following.Follower(tmp_path, lambda status: told.set())
    follower.begin()
    try:
        assert told.wait(20)
        threading.Event().wait(0.3)
        assert follower.status is GONE
        assert Dead.heard == 1
    finally:
        follower.end()


# --- calibrations on the page: same results as the command line
AT = (100.0, 100.0, 50.0)


def weighed(share: float) -> Read:
    """Doses of a plunger whose steps give ``share`` of what they should."""
    syringe = load(Syringe, "hamilton_1ml")
    area = math.pi / 4 * syringe.inner_mm**2
    rng = np.random.default_rng(1)
    rows = []
    for ul in (20.0, 40.0, 60.0) * 4:
        mass = 0.998 * ul * share + rng.normal(0, 0.02)
        rows.append((f"{ul / area:.5f}", f"{mass:.2f}"))
    return Read(rows=tuple(rows), printer="generic_marlin", syringe="hamilton_1ml")


def test_a_test_lies_among_the_jobs_with_its_sheet(idle: PrinterService) -> None:
    made = idle.calibrating.make(
        ME, "weigh", CalibrationRequest(printer="generic_marlin", at_mm=AT)
    )
    job = idle.core.workspace.job_file(made.job)
    assert made.job in idle.core.workspace.jobs()
    assert len(made.rows) == 12
    assert all(row[-1] == "" for row in made.rows)
    assert job.with_suffix(".csv").read_text().startswith("travel_mm,mass_mg\n")
    assert made.lines > 24


def test_a_test_that_preflight_refuses_is_not_written(idle: PrinterService) -> None:
    outside = CalibrationRequest(printer="generic_marlin", at_mm=(199.0, 100.0, 50.0), axis="x")
    with pytest.raises(Exception, match=r"(?i)outside|exceed|x_mm"):
        idle.calibrating.make(ME, "backlash", outside)
    assert idle.core.workspace.jobs() == []


def test_weighing_finds_the_steps_and_writes_a_copy_that_can_be_connected(
    idle: PrinterService,
) -> None:
    read = weighed(0.9)
    found = idle.calibrating.fit("weigh", read).lines["steps per travel, if the bore is right"]
    steps = load(Printer, "generic_marlin").steps_per_mm.e
    assert found.holds(steps / 0.9)
    idle.calibrating.save(ME, read, "printer", "bench_1")
    assert "bench_1" in idle.store.printers()
    copy = idle.store.load(Printer, "bench_1")
    assert copy.steps_per_mm.e == pytest.approx(steps / 0.9, rel=0.01)
    assert "measured by printctl calibrate" in copy.source
    idle.calibrating.save(ME, read, "syringe", "syringe_1")
    bore = idle.store.load(Syringe, "syringe_1").inner_mm
    assert bore == pytest.approx(load(Syringe, "hamilton_1ml").inner_mm * math.sqrt(0.9), rel=0.01)


def test_a_copy_does_not_take_a_shipped_name_or_leave_its_folder(
    idle: PrinterService, tmp_path: Path
) -> None:
    before = sorted(tmp_path.rglob("*.yaml"))
    with pytest.raises(ConflictError, match="another"):
        idle.calibrating.save(ME, weighed(0.9), "printer", "generic_marlin")
    with pytest.raises(BadRequestError):
        idle.calibrating.save(ME, weighed(0.9), "printer", "../evil")
    assert sorted(tmp_path.rglob("*.yaml")) == before


def test_a_second_printer_is_not_connected_over_the_first(service: PrinterService) -> None:
    with pytest.raises(ConflictError, match="disconnect it first"):
        service.connect(ME, "marlin_avr", "simulated")


def test_only_who_holds_the_controls_moves_but_anyone_stops(service: PrinterService) -> None:
    service.core.controls.take(ME)
    for refused in (
        lambda: service.commands.jog(OTHER, "x", 1.0),
        lambda: service.commands.heat(OTHER, "bed", 30.0),
        lambda: service.commands.plunger(OTHER, 1.0),
        lambda: service.commands.mount(OTHER, needle="25g"),
        lambda: service.console.send(OTHER, "M105"),
        lambda: service.guide.start(OTHER, "floor"),
        lambda: service.disconnect(OTHER),
    ):
        with pytest.raises(NotInControlError, match="the operator holds the controls"):
            refused()
    assert service.stop_motion().open


# --- rEST routes of the printer, used as a script would
API = "/api/v1/printer"


async def _as_named(request: Request, go_on: RequestResponseEndpoint) -> Response:
    """Stand in for the guard at the door: whoever the request says it is."""
    name = request.headers.get("x-name", "script")
    request.state.principal = Principal(name, name)
    return await go_on(request)


def client_of(service: PrinterService) -> TestClient:
    app = FastAPI()
    answer_errors(app)
    app.include_router(router(service))
    app.add_middleware(BaseHTTPMiddleware, dispatch=_as_named)
    return TestClient(app)


@pytest.fixture
def api(service: PrinterService) -> Iterator[TestClient]:
    # The fixture's own moves were made by ME, who lets go.
    service.core.controls.release(Principal("me"))
    with client_of(service) as client:
        yield client


def test_status_ports_and_profiles_are_told(api: TestClient) -> None:
    status = api.get(f"{API}/status").json()
    assert status["state"] == "ready"
    assert status["position_mm"] == [0.0, 0.0, 0.0]
    assert isinstance(api.get(f"{API}/ports").json(), list)
    names = [one["name"] for one in api.get(f"{API}/profiles").json()]
    assert "generic_marlin" in names
    assert "aerotech_pneumatic" not in names  # takes no lines from a host


def test_status_adds_what_follows_from_the_parts(api: TestClient) -> None:
    before = api.get(f"{API}/status").json()
    assert before["state_words"].startswith("ready: connected, checked")
    assert before["printer"] == "generic_marlin"
    assert before["fastest_ul_s"] is None
    api.post(f"{API}/mount", json={"syringe": "hamilton_1ml", "ink": "collagen_fresh"})
    status = api.get(f"{API}/status").json()
    assert status["parts"] == {
        "needle": "",
        "syringe": "hamilton_1ml",
        "ink": "collagen_fresh",
        "dish": "",
        "bath": "",
    }
    assert status["fastest_ul_s"] == load(Ink, "collagen_fresh").plunger_ul_s
    assert status["full_ul"] == load(Syringe, "hamilton_1ml").volume_ul - 20.0


def test_parts_are_described_and_one_that_cannot_be_read_hides_no_other(
    idle: PrinterService,
) -> None:
    bad = idle.store.folder(Needle) / "mine.yaml"
    bad.parent.mkdir(parents=True)
    bad.write_text("inner_mm: wide\n")
    with client_of(idle) as api:
        parts = api.get(f"{API}/parts").json()
    assert set(parts) == {"needle", "syringe", "ink", "dish", "bath"}
    needles = {one["name"]: one["about"] for one in parts["needle"]}
    assert needles["25g"].startswith("bore 0.26 mm")
    assert needles["mine"].startswith("can't be read")
    volumes = {one["name"]: one["volume_ul"] for one in parts["syringe"]}
    assert volumes["hamilton_1ml"] == 1000.0


def test_a_script_jogs_heats_pushes_and_types(api: TestClient) -> None:
    moved = api.post(f"{API}/jog", json={"axis": "z", "mm": 5.0})
    assert moved.status_code == 200
    assert moved.json()["position_mm"][2] == pytest.approx(5.0)
    assert api.post(f"{API}/heat", json={"name": "bed", "celsius": 25}).status_code == 200
    assert api.post(f"{API}/heaters-off").status_code == 200
    mounted = api.post(
        f"{API}/change/syringe",
        json={"syringe": "hamilton_1ml", "ink": "collagen_fresh", "filled_ul": 800},
    ).json()
    pushed = api.post(f"{API}/plunger", json={"ul": 1.0, "ul_s": 0.3}).json()
    assert mounted["ul_left"] - pushed["ul_left"] == pytest.approx(1.0, abs=0.02)
    said = api.post(f"{API}/command", json={"text": "M115"}).json()["replies"]
    assert any("FIRMWARE_NAME" in line for line in said)
    assert api.get(f"{API}/console").json()[-1]["text"] == "M115"
    assert set(api.get(f"{API}/temperatures").json()) >= {"at_s", "now_c"}


def test_refusals_have_a_status_and_say_why(api: TestClient) -> None:
    far = api.post(f"{API}/jog", json={"axis": "x", "mm": -20})
    assert far.status_code == 409
    assert "outside 0 to 200 mm" in far.json()["message"]
    assert api.post(f"{API}/jog", json={"axis": "e", "mm": 1}).status_code == 422
    assert api.post(f"{API}/jog", json={"axis": "x", "mm": 1, "by": 2}).status_code == 422
    assert api.post(f"{API}/command", json={"text": "M105\nM112"}).status_code == 422
    assert api.post(f"{API}/macros/run/none").status_code == 404
    assert api.post(f"{API}/calibrations/none/job", json={}).status_code == 422


def test_nan_is_refused(api: TestClient) -> None:
    raw = api.post(
        f"{API}/jog",
        content='{"axis": "x", "mm": NaN}',
        headers={"content-type": "application/json"},
    )
    assert raw.status_code == 422


def test_another_browser_is_refused_while_one_holds_the_controls(api: TestClient) -> None:
    assert api.post(f"{API}/jog", json={"axis": "x", "mm": 1}).status_code == 200
    other = api.post(f"{API}/jog", json={"axis": "x", "mm": 1}, headers={"x-name": "office"})
    assert other.status_code == 423
    stop = api.post(f"{API}/stop-motion", headers={"x-name": "office"})
    assert stop.status_code == 200


def test_touching_off_by_script(api: TestClient) -> None:
    mount = {"needle": "25g", "dish": "petri_60mm", "dish_centre_mm": [100, 100]}
    assert api.post(f"{API}/mount", json=mount).json()["needs_touch_off"]
    begun = api.post(f"{API}/touch-off", json={"surface": "floor", "foil_mm": 0.0})
    assert begun.json()["touching"]["readings_mm"] == []
    assert api.post(f"{API}/touch-off/use").status_code == 409
    for _ in range(3):
        api.post(f"{API}/touch-off/reading")
    used = api.post(f"{API}/touch-off/use").json()
    assert used["mounted"]["floor_mm"] == pytest.approx(0.0)
    assert not used["needs_touch_off"]
    assert api.get(f"{API}/touch-off").json() == {"touching": None}


def test_macros_by_script(api: TestClient) -> None:
    macro = {"name": "where", "commands": ["M114"]}
    kept = api.put(f"{API}/macros/generic_marlin", json=macro)
    assert kept.json()["macros"] == [macro]
    assert "X:" in " ".join(api.post(f"{API}/macros/run/where").json()["replies"])
    assert api.delete(f"{API}/macros/generic_marlin/where").json()["macros"] == []
    assert api.get(f"{API}/macros/..%2F..%2Fetc").status_code in (404, 422)


def test_a_calibration_by_script(api: TestClient) -> None:
    listed = api.get(f"{API}/calibrations").json()
    assert {"weigh", "level", "offset", "backlash"} <= {one["name"] for one in listed}
    asked = {"printer": "generic_marlin", "at_mm": [100, 100, 50]}
    made = api.post(f"{API}/calibrations/weigh/job", json=asked).json()
    assert made["job"].startswith("file~calibrate_weigh_")
    rows = [[row[0], f"{float(row[0]) * 17.0:.2f}"] for row in made["rows"]]
    found = api.post(f"{API}/calibrations/weigh/fit", json={"rows": rows}).json()
    assert found["estimates"]["volume per travel"]["value"] == pytest.approx(17.034, abs=0.01)


def test_without_a_printer_every_request_is_a_conflict(idle: PrinterService) -> None:
    with client_of(idle) as api:
        for path, body in (
            ("jog", {"axis": "x", "mm": 1}),
            ("home", {"axes": ["x"]}),
            ("lift-out", None),
            ("set-position", {"z": 1}),
            ("disconnect", None),
            ("reconnect", None),
            ("stop-motion", None),
            ("heat", {"name": "bed", "celsius": 20}),
            ("plunger", {"ul": 1}),
            ("command", {"text": "M105"}),
            ("mount", {"needle": "25g"}),
            ("touch-off", {"surface": "floor"}),
            ("change/purge", {"ul": 1}),
        ):
            answer = api.post(f"{API}/{path}", json=body)
            assert answer.status_code == 409, path
            assert "connect" in answer.json()["message"], path
