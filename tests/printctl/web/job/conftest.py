"""Fixtures: a workspace with jobs, and a simulated printer behind a station."""

from __future__ import annotations

import io
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from printctl.machine.errors import Refused
from printctl.machine.process.clients.client import Station
from printctl.machine.process.clients.starting import connect
from printctl.web.controls import Principal
from printctl.web.core import Core
from printctl.web.job.aftercare import checklist
from printctl.web.job.service import JobService
from printctl.web.job.set_up import JobSetUp
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace
from tests.printctl.machine.link.layered import layered

START = (50.0, 50.0, 10.0)
WORDS = "generic_marlin on simulated"
MOUNTED = {
    "syringe": "hamilton_1ml",
    "ink": "collagen_fresh",
    "needle": "28g",
    "bath": "gelatin_support",
}
OPERATOR = Principal("one", "Ada")
OTHER = Principal("two", "Grace")


@pytest.fixture
def core(tmp_path: Path) -> Core:
    return Core(ServeSettings(tmp_path), Workspace(tmp_path).make())


@pytest.fixture
def service(core: Core) -> Iterator[JobService]:
    made = JobService(core)
    yield made
    made.close()


@pytest.fixture
def station(core: Core) -> Iterator[Station]:
    """Twenty times as fast as life, so that a print can be caught in the middle."""
    opened = connect(
        "generic_marlin", "simulated", core.workspace.station, sim_speed=20.0, start_mm=START
    )
    opened.mount(**MOUNTED)
    yield opened
    shut(opened)


def shut(station: Station) -> None:
    """Close it as soon as it has noticed its print's end."""
    limit = time.monotonic() + 30
    if station.status.state == "printing":
        station.kill()
    while True:
        try:
            return station.close()
        except Refused:
            if time.monotonic() > limit:
                raise
            time.sleep(0.05)


def add(service: JobService, name: str = "zigzag.gcode", layers: int = 6, moves: int = 60) -> str:
    return service.upload(name, io.BytesIO(layered(layers, moves))).id


def ready(service: JobService, job: str) -> JobSetUp:
    """Fill in all that a start wants."""
    points = {point["id"]: True for point in checklist()["before"]}
    service.write_down(OPERATOR, job, {"operator": "Ada", "ticked": points})
    service.confirm_set_up(OPERATOR, job)
    return service.set_up(job)
