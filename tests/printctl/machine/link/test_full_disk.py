"""Disk full during a print: the journal keeps reserved space for final records."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.errors import Refused
from printctl.machine.link.journal import RESERVE, Journal
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.recovery_begin import beginning
from printctl.machine.link.resuming import resumable
from printctl.machine.link.states import LinkState, Status
from printctl.machine.link.streamer import Streamer
from sim.devices.families.marlin.printer import MarlinPrinter
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import PRINTER, START, gcode, printed


class SmallDisk:
    """Stands for ``os.write`` on a disk that takes so many bytes; each write takes what fits."""

    def __init__(self, folder: Path, size: int) -> None:
        self._write, self._folder, self._size = os.write, folder, size
        self.others = 0

    def __call__(self, fd: int, data: bytes) -> int:
        used = sum(file.stat().st_size for file in self._folder.iterdir())
        left = self._size - used - self.others
        if left <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return self._write(fd, data[:left])


def print_on(disk: SmallDisk, journal: Journal, monkeypatch) -> tuple[Status, Streamer]:
    transport = SimTransport(MarlinPrinter(PRINTER, START), VirtualClock())
    monkeypatch.setattr(os, "write", disk)
    found = printed(gcode(300), journal.path.parent, transport, journal=journal)
    monkeypatch.undo()
    journal.close()
    return found


@pytest.mark.parametrize("room", range(2007, 2060, 7))  # at 2000 two lines pass there
def test_end_of_a_print_on_a_full_disk_is_in_its_journal(tmp_path, monkeypatch, room):
    journal = Journal(tmp_path / "journal.log", reserve=True)
    status, streamer = print_on(SmallDisk(tmp_path, room + 65_536), journal, monkeypatch)
    assert status.state is LinkState.FAILED
    assert "disk full" in status.message or "No space" in status.message
    history = read_journal(journal.path)
    assert history.end["message"] == status.message
    assert history.damaged == 0
    begin = beginning(streamer.job, history, PRINTER, None)
    assert begin.index == status.lines_executed
    assert "nothing is left out or written twice" in begin.stood
    assert not (tmp_path / RESERVE).exists()


def test_print_whose_end_didnt_fit_isnt_gone_on_with(tmp_path, monkeypatch):
    """Somebody else takes the room that was kept back."""
    journal = Journal(tmp_path / "journal.log", reserve=True)
    disk = SmallDisk(tmp_path, 68_000)

    def greedy(self: Journal) -> bool:
        disk.others = 1_000_000
        return used(self)

    used = Journal.use_reserve
    monkeypatch.setattr(Journal, "use_reserve", greedy)
    _, streamer = print_on(disk, journal, monkeypatch)
    history = read_journal(journal.path)
    assert history.end is None
    with pytest.raises(Refused, match="the disk was full"):
        resumable(tmp_path, streamer.job.sha256)


def test_room_that_was_kept_back_is_free_after_a_print(tmp_path):
    journal = Journal(tmp_path / "journal.log", reserve=True)
    assert (tmp_path / RESERVE).stat().st_size > 60_000
    journal.add("end", state="done", message="", done=1)
    journal.close()
    assert not (tmp_path / RESERVE).exists()


def test_reserve_stays_for_a_print_that_is_gone_on_with(tmp_path):
    Journal(tmp_path / "journal.log", reserve=True).close()
    assert (tmp_path / RESERVE).stat().st_size > 60_000
    assert not read_journal(tmp_path / "journal.log").cut_short
