"""REST routes of the printer, used as a script would."""

from collections.abc import Iterator

import pytest
from fastapi import FastAPI, Request
from fastapi.testclient import TestClient
from starlette.middleware.base import BaseHTTPMiddleware, RequestResponseEndpoint
from starlette.responses import Response

from printctl.web.api import answer_errors
from printctl.web.controls import Principal
from printctl.web.printer.routes import router
from printctl.web.printer.service import PrinterService

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
