"""Mounted parts: read once from an earlier version's file, and kept apart for each machine."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from printctl.machine.errors import PortInUse, Refused
from printctl.machine.process.clients.starting import connect
from printctl.machine.process.contact import STATION_RECORD, load_station
from printctl.machine.records.mounting import load_mounting, mounting_file
from tests.printctl.machine.link.fake_marlin import FakeMarlin, pty_printer
from tests.printctl.machine.link.jobs import quick_profile


@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))


def test_an_earlier_version_s_station_record_is_read_once(tmp_path: Path) -> None:
    folder = tmp_path / "station"
    for needle in ("28g", "25g"):
        station = connect("generic_marlin", "simulated", folder, sim_speed=0.0)
        if needle == "28g":
            station.mount(needle=needle, syringe="bd_1ml", ink="collagen_fresh", plunger_mm=3.0)
        assert station.status.mounted.needle == "28g"
        station.close()
        record = json.loads((folder / STATION_RECORD).read_text())
        if needle == "28g":
            mounting_file("generic_marlin", folder).unlink()  # as an earlier version left it
        else:
            assert load_mounting("generic_marlin", folder).parts.syringe == "bd_1ml"
            assert load_mounting("generic_marlin", folder).plunger_mm is None
            record["status"]["mounted"]["needle"] = needle  # nobody reads it any more
            (folder / STATION_RECORD).write_text(json.dumps(record))
    station = connect("generic_marlin", "simulated", folder, sim_speed=0.0)
    assert station.status.mounted.needle == "28g"
    station.close()


def test_a_second_machine_by_the_same_profile_is_refused_while_the_first_is_at_work(
    tmp_path: Path,
) -> None:
    profile = quick_profile(tmp_path)
    with pty_printer(FakeMarlin()) as one, pty_printer(FakeMarlin()) as other:
        first = connect(profile, one.name, tmp_path / "one")
        with pytest.raises(Refused, match=r"is at work by the same profile.*a copy of the profile"):
            connect(profile, other.name, tmp_path / "two")
        assert load_station(tmp_path / "two").status["state"] == "lost"
        with pytest.raises(
            PortInUse, match=r"by printctl itself, .*/one: `printctl station status"
        ):
            connect(profile, one.name, tmp_path / "three")
        first.close()
        second = connect(profile, other.name, tmp_path / "two")
        second.close()
