"""Station whose final record couldn't be written: last message."""

from __future__ import annotations

import errno
import os
import time
from pathlib import Path

import pytest

from printctl.machine.link.errors import LinkError, NoLink
from printctl.machine.link.journal import Journal
from printctl.machine.station import StationState, StationStatus, attach, process
from printctl.machine.station.process import Opening, serve_station
from printctl.machine.station.record import JOURNAL, StationRecord, load_station
from printctl.machine.station.status import NO_PRINTER, MountedParts


def _left_printing(folder: Path, *states: str) -> None:
    """Leave the record of a station that printed, as a full disk keeps it, and its journal."""
    status = StationStatus(StationState.PRINTING).to_dict()
    record = StationRecord(0, "", "t", "generic_marlin", "simulated", None, time.time(), status)
    record.save(folder)
    journal = Journal(folder / JOURNAL)
    for state in states:
        journal.add("state", state=state, message=f"{state} by the journal")
    journal.close()


def test_close_that_only_the_journal_holds_is_told(tmp_path: Path) -> None:
    _left_printing(tmp_path, "ready", "halted", "closed")
    status = attach(tmp_path).status
    assert (status.state, status.message) == (StationState.CLOSED, "closed by the journal")


@pytest.mark.parametrize(
    ("states", "while_"), [(("ready", "halted"), "halted"), (("ready",), "printing")]
)
def test_end_without_a_word_is_told_with_the_last_state(
    tmp_path: Path, states: tuple[str, ...], while_: str
) -> None:
    _left_printing(tmp_path, *states)
    status = attach(tmp_path).status
    assert status.state is StationState.LOST
    assert f"without a word while {while_}" in status.message


def test_close_of_an_earlier_station_is_not_taken(tmp_path: Path) -> None:
    journal = Journal(tmp_path / JOURNAL)
    journal.add("state", state="closed", message="earlier")
    journal.close()
    time.sleep(0.01)
    _left_printing(tmp_path)
    assert attach(tmp_path).status.state is StationState.LOST


def test_whatever_is_asked_of_a_station_that_is_gone_is_answered_alike(tmp_path: Path) -> None:
    _left_printing(tmp_path, "ready")
    station = attach(tmp_path)
    for ask in (
        lambda: station.jog("x", 1),
        lambda: station.command("M105"),
        station.reconnect,
        station.close,
    ):
        with pytest.raises(NoLink, match=NO_PRINTER.partition(";")[0]):
            ask()


# --- full disk at a station's start or end
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
