"""Fixtures: REST of the Printer page, with a simulated printer behind a station."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI, Request
from fastapi.testclient import TestClient
from starlette.middleware.base import BaseHTTPMiddleware, RequestResponseEndpoint
from starlette.responses import Response

from printctl.machine.control.idle.station_status import StationState
from printctl.web.api import answer_errors
from printctl.web.controls import Principal
from printctl.web.core import Core
from printctl.web.printer.routes import router
from printctl.web.printer.service import PrinterService
from printctl.web.rest import API
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace
from tests import waiting

ME = Principal("me", "the operator")


class Script:
    """Who asks by REST."""

    def __init__(self, client: TestClient) -> None:
        self.client = client

    def ask(self, path: str, body: object = None, *, do: str = "POST", who: str = "me") -> Any:
        """Send a request; give the answer."""
        headers = {"x-name": who}
        return self.client.request(do, f"{API}/printer/{path}", json=body, headers=headers)

    def get(self, path: str) -> Any:
        """Give what is there."""
        return self.ask(path, do="GET").json()

    def do(self, path: str, **body: object) -> Any:
        """Have something done that must succeed; give what it says."""
        answer = self.ask(path, body or None)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def refused(self, path: str, **body: object) -> tuple[int, str]:
        """Ask for what must be refused; give status and message."""
        answer = self.ask(path, body or None)
        return answer.status_code, answer.json()["message"]


def make_service(root: Path) -> PrinterService:
    workspace = Workspace(root).make()
    return PrinterService(Core(ServeSettings(root, sim_speed=0.0), workspace))


async def _as_named(request: Request, go_on: RequestResponseEndpoint) -> Response:
    """Stand in for the guard at the door: whoever the request says it is."""
    name = request.headers["x-name"]
    request.state.principal = Principal(name, name)
    return await go_on(request)


def script_of(service: PrinterService) -> Script:
    app = FastAPI()
    answer_errors(app)
    app.include_router(router(service))
    app.add_middleware(BaseHTTPMiddleware, dispatch=_as_named)
    return Script(TestClient(app))


@pytest.fixture
def idle(tmp_path: Path) -> Iterator[PrinterService]:
    """A room without a printer."""
    service = make_service(tmp_path)
    yield service
    service.close()


@pytest.fixture(scope="session")
def station_root(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A workspace whose station has the simulated printer open; a second or more to start."""
    root = tmp_path_factory.mktemp("ws")
    service = make_service(root)
    service.connect(ME, "generic_marlin", "simulated")
    yield root
    service.disconnect(ME)
    service.close()


@pytest.fixture
def service(station_root: Path) -> Iterator[PrinterService]:
    """A room of its own server with that station, found again; bare needle, position trusted."""
    service = make_service(station_root)
    wait_for(service, lambda: service.status.state is StationState.READY)
    bare = dict.fromkeys(("needle", "syringe", "ink", "dish", "bath"), "")
    station = service.station()
    station.mount(**bare, floor_mm=None, bath_level_mm=None, dish_centre_mm=None)
    service.heard(station.home())
    yield service
    service.close()


@pytest.fixture
def own_api(tmp_path: Path) -> Iterator[Script]:
    """REST of a printer that is connected for one test, and may be stopped."""
    service = make_service(tmp_path)
    service.connect(ME, "generic_marlin", "simulated")
    yield script_of(service)
    service.disconnect(ME)
    service.close()


@pytest.fixture
def api(service: PrinterService) -> Script:
    """Its REST."""
    return script_of(service)


@pytest.fixture
def idle_api(idle: PrinterService) -> Script:
    """REST of a room without a printer."""
    return script_of(idle)


def wait_for(service: PrinterService, true: Callable[[], bool]) -> None:
    """Wait until something holds; fails after half a minute."""
    waiting.wait_for(true, told=lambda: service.status)
