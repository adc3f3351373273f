"""The wire log: bounded, in order, and kept where something went wrong."""

from __future__ import annotations

import ast

from printctl.link.clock import VirtualClock
from printctl.link.transport_scripted import ScriptedTransport
from printctl.link.wire_log import RING_BYTES, LoggedTransport, WireLog


def traffic(text: str) -> list[tuple[str, bytes]]:
    return [
        (line.split()[1], ast.literal_eval(line.split(None, 2)[2])) for line in text.splitlines()
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
