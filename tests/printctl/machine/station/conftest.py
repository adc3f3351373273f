"""Station fixtures: with the simulated printer, and with a fake behind a pseudo-terminal."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from printctl.machine.process.clients.client import Station
from printctl.machine.process.clients.starting import connect


@pytest.fixture(scope="module")
def sim(tmp_path_factory, profile) -> Iterator[Station]:
    """A simulated printer in virtual time, with its tip at 100, 100, 50."""
    folder = tmp_path_factory.mktemp("station")
    station = connect(profile, "simulated", folder, sim_speed=0, start_mm=(100, 100, 50))
    yield station
    if station.status.open:
        station.close()


@pytest.fixture
def at_rest(sim: Station) -> Station:
    """That printer with nothing mounted, its tip at 100, 100, 50."""
    sim.mount(needle="", syringe="", ink="", dish="", bath="", dish_centre_mm=None)
    sim.set_position(100, 100, 50)
    return sim


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "station"
