"""Fixtures: Printer page service with a simulated printer behind a station."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from printctl.machine.station import StationState
from printctl.web.controls import Principal
from printctl.web.core import Core
from printctl.web.printer.service import PrinterService
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace
from tests import waiting

ME = Principal("me", "the operator")
OTHER = Principal("other", "the office")


def make_service(root: Path) -> PrinterService:
    workspace = Workspace(root).make()
    return PrinterService(Core(ServeSettings(root, sim_speed=0.0), workspace))


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
    service.commands.mount(ME, **bare, floor_mm=None, bath_level_mm=None, dish_centre_mm=None)
    service.commands.home(ME, ["x", "y", "z"])
    yield service
    service.close()


def wait_for(service: PrinterService, true: Callable[[], bool]) -> None:
    """Wait until something holds; fails after half a minute."""
    waiting.wait_for(true, told=lambda: service.status)
