"""Connections of the stop process: those that lead to the same machine."""

from __future__ import annotations

import json
import socket
from pathlib import Path

from printctl.machine.link.command_socket import listen
from printctl.web.stop_process.connections import Wires


def _recorded(path: Path, pid: int) -> socket.socket:
    path.parent.mkdir(parents=True)
    listener, address, token = listen(path.parent, "x.sock")
    path.write_text(json.dumps({"pid": pid, "address": address, "token": token}))
    return listener


def test_station_and_its_print_are_told_as_one_process(tmp_path: Path) -> None:
    kept = [
        _recorded(tmp_path / "station" / "station.json", 7),
        _recorded(tmp_path / "jobs" / "a.print" / "link.json", 7),
        _recorded(tmp_path / "runs" / "b" / "print" / "link.json", 8),
    ]
    wires = Wires(tmp_path)
    sent = list(wires.kill(0.0))
    wires.close()
    for one in kept:
        one.close()
    assert len(sent) == len(kept)
    assert sorted(one.process for one in sent) == [7, 7, 8]
