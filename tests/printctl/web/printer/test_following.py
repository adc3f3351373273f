"""A station that was killed, followed: heard once, and looked for again after a while."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from printctl.machine.station import StationState, StationStatus
from printctl.web.printer import following

GONE = StationStatus(StationState.LOST, "the station ended without a word")


class Dead:
    """What is attached to where a station was killed."""

    status = GONE
    heard = 0

    def events(self) -> Iterator[StationStatus]:
        Dead.heard += 1
        yield GONE

    def detach(self) -> None:
        """There is nothing to detach from."""


def test_a_dead_station_keeps_no_core_busy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its last word was read thousands of times a second, from a journal that grew."""
    elsewhere = following.attach  # servers of other tests may still follow theirs
    monkeypatch.setattr(
        following, "attach", lambda folder: Dead() if folder == tmp_path else elsewhere(folder)
    )
    monkeypatch.setattr(following, "LOOK_AGAIN_S", 60.0)
    told = threading.Event()
    follower = following.Follower(tmp_path, lambda status: told.set())
    follower.begin()
    try:
        assert told.wait(20)
        threading.Event().wait(0.3)
        assert follower.status is GONE
        assert Dead.heard == 1
    finally:
        follower.end()
