"""Wire log: bounded, ordered, kept after a failure."""

from __future__ import annotations

import ast
import time
from pathlib import Path

import pytest

from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.wire_log import RING_BYTES, LoggedTransport, WireLog
from tests.printctl.machine.link.scripted_transport import ScriptedTransport


def traffic(text: str) -> list[tuple[str, bytes]]:
    return [
        (line.split()[1], ast.literal_eval(line.split(None, 2)[2]))
        for line in text.splitlines()
        if " # " not in line
    ]


def test_both_directions_and_the_urgent_are_kept_in_order_with_times(tmp_path):
    log = WireLog(tmp_path)
    wire = LoggedTransport(ScriptedTransport(lambda data: b"ok\n", VirtualClock()), log)
    wire.write(b"N1 M105*36\n")
    assert wire.read(1.0) == b"ok\n"
    wire.write_urgent(b"\nM112\n")
    log.keep(tmp_path / "kept.log")
    log.close()
    kept = (tmp_path / "kept.log").read_text()
    assert traffic(kept) == [(">", b"N1 M105*36\n"), ("<", b"ok\n"), ("!", b"\nM112\n")]
    assert (tmp_path / "wire.log").read_text() == kept
    times = [float(line.split()[0]) for line in kept.splitlines()]
    assert times == sorted(times)


def test_only_the_last_traffic_is_held_in_memory(tmp_path):
    log = WireLog()
    for k in range(20_000):
        log.add(">", b"N%d G1 X1.000 Y2.000 E0.01000*77\n" % k)
    log.keep(tmp_path / "kept.log")
    lines = traffic((tmp_path / "kept.log").read_text())
    assert sum(len(data) for _, data in lines) < RING_BYTES
    assert lines[-1][1].startswith(b"N19999 ")


def test_second_nought_is_told_by_the_wall_clock(tmp_path):
    """Else the log's times can't be held against the journal's."""
    began = time.time()
    log = WireLog(tmp_path)
    log.add(">", b"M105\n")
    log.keep(tmp_path / "kept.log")
    log.close()
    for name in ("kept.log", "wire.log"):
        first = (tmp_path / name).read_text().splitlines()[0].split()
        assert first[:2] == ["0.000000", "#"]
        assert began <= float(ast.literal_eval(first[2])) <= time.time()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_full_disk_ends_the_log_and_nothing_else():
    """An error in there would end the link process, or a kill before its M112 is repeated."""
    log = WireLog(Path("/dev/full"))
    wire = LoggedTransport(ScriptedTransport(lambda data: b"ok\n", VirtualClock()), log)
    wire.write_urgent(b"\nM112\n")
    wire.write(b"N1 M105*36\n")
    assert wire.read(1.0) == b"ok\nok\n"
    log.close()
    assert "No space left" in log.lost
