"""Station whose final record couldn't be written: last message."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from printctl.machine.link.errors import NoLink
from printctl.machine.link.journal import Journal
from printctl.machine.station import StationState, StationStatus, attach
from printctl.machine.station.record import JOURNAL, StationRecord
from printctl.machine.station.status import NO_PRINTER


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
