"""Invalid ADVANCED_OK fields: treated as a plain ok, reported once."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from firmware_profiles.families.marlin.replies import Kind, classify
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.journal import read_records
from printctl.machine.link.states import LinkState
from sim.devices.families.marlin.printer import MarlinPrinter
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import PRINTER, START, gcode, printed

FACTS = PRINTER.model_copy(update={"advanced_ok": True})


class Lying(SimTransport):
    """Rewrites each answer."""

    def __init__(self, pattern: bytes, by: bytes) -> None:
        super().__init__(MarlinPrinter(FACTS, START), VirtualClock())
        self._pattern, self._by, self._rest = re.compile(pattern), by, b""

    def read(self, timeout: float) -> bytes:
        whole, end, self._rest = (self._rest + super().read(timeout)).rpartition(b"\n")
        return self._pattern.sub(self._by, whole + end)


def told_odd(folder: Path) -> list[str]:
    texts = [r["text"] for r in read_records(folder / "journal.log") if r and r["t"] == "notice"]
    return [text for text in texts if "ADVANCED_OK" in text]


@pytest.mark.parametrize(
    "room",
    [b"P99 B99", b"P0 B0", b"P-1 B999999999999999999999", b"P1.5 B0.25", b"P-3 B-3", b"P7 B2"],
)
def test_room_that_lies_costs_nothing(tmp_path, room):
    transport = Lying(rb"P\d+ B\d+", room)
    status, _ = printed(gcode(100), tmp_path, transport)
    assert status.state is LinkState.DONE
    assert status.line_errors == status.alarms == 0
    assert len(told_odd(tmp_path)) == (room.startswith((b"P-", b"P1.")))
    assert transport.clock.now() < 60


def test_number_that_never_changes_is_read_as_a_plain_ok(tmp_path):
    status, _ = printed(gcode(100), tmp_path, Lying(rb"ok N\d+", b"ok N5"))
    assert status.state is LinkState.DONE
    assert len(told_odd(tmp_path)) == 1


@pytest.mark.parametrize("text", [b"ok N48 P1x B3", b"ok N4? P15 B3", b"ok P-1 Bx"])
def test_garbled_fields_are_no_ok(text):
    assert classify(text).kind is not Kind.OK
