"""Full disk at a station's start or end."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from printctl.machine.link.errors import LinkError
from printctl.machine.station import StationState, StationStatus, process
from printctl.machine.station.process import Opening, serve_station
from printctl.machine.station.record import StationRecord, load_station
from printctl.machine.station.status import MountedParts


class Disk:
    """Full on demand: whatever is written to it then is refused, as the system does."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.full = False
        write = Path.write_bytes

        def written(path: Path, data: bytes) -> int:
            if self.full:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
            return write(path, data)

        monkeypatch.setattr(Path, "write_bytes", written)


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    return Disk(monkeypatch)


def opening(folder: Path) -> Opening:
    return Opening("generic_marlin", "simulated", folder, None, 1.0, (0.0, 0.0, 0.0))


def test_a_station_that_cant_write_its_last_record_ends_by_its_status(
    tmp_path: Path, disk: Disk, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed = StationStatus(StationState.CLOSED, "closed")

    def served(_: Opening, record: StationRecord, before: object) -> object:
        ready = StationStatus(StationState.READY, "ready").to_dict()
        good = StationRecord(record.pid, "", "t", "p", "q", None, 1.0, ready, plunger_mm=12.5)
        good.save(tmp_path)
        disk.full = True
        return record, closed

    monkeypatch.setattr(process, "_open", served)
    assert serve_station(opening(tmp_path)) == closed
    kept = load_station(tmp_path)
    assert (kept.plunger_mm, kept.last.state) == (12.5, StationState.READY)


def test_a_station_that_cant_write_its_first_record_says_so_and_leaves_the_older_one(
    tmp_path: Path, disk: Disk
) -> None:
    StationRecord(1, "", "", "p", "q", None, 1.0, plunger_mm=12.5).save(tmp_path)
    disk.full = True
    with pytest.raises(LinkError, match=r"station\.json can't be written.*free space"):
        serve_station(opening(tmp_path))
    assert load_station(tmp_path).plunger_mm == 12.5


def test_what_was_known_outlives_a_station_that_dies_before_it_is_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    status = StationStatus(StationState.CLOSED, mounted=MountedParts(needle="30g")).to_dict()
    StationRecord(1, "", "", "p", "q", None, 1.0, status, 12.5, True).save(tmp_path)
    seen = []
    monkeypatch.setattr(
        process, "_open", lambda _, record, before: seen.append(load_station(tmp_path)) or 1 / 0
    )
    with pytest.raises(ZeroDivisionError):
        serve_station(opening(tmp_path))
    for kept in (seen[0], load_station(tmp_path)):
        assert (kept.plunger_mm, kept.part_in_dish, kept.mounted.needle) == (12.5, True, "30g")
