"""Short waits, and boards that end with their test."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from printctl.machine.network import file_print, http_client
from tests.printctl.machine.network.boards import BoardServer


@pytest.fixture(autouse=True)
def short_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("POLL_S", "SILENT_S", "SETTLE_S", "DECIDE_S", "CONNECT_S", "HALT_S"):
        factor = 0.1 if name != "HALT_S" else 0.5
        monkeypatch.setattr(file_print, name, factor * getattr(file_print, name))
    monkeypatch.setattr(http_client, "CHECK_READY_S", 0.05)
    monkeypatch.delenv("PRINTCTL_HOST_KEY", raising=False)
    monkeypatch.delenv("PRINTCTL_HOST_KEY_FILE", raising=False)


@pytest.fixture(params=[False, True], ids=["standalone", "sbc"])
def server(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[BoardServer]:
    board = BoardServer(tmp_path / "card", sbc=request.param)
    yield board
    board.board.status = "halted"
    board.down()
