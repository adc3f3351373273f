"""Another Klipper client's commands during a print, whose replies the link never receives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firmware_profiles import Printer, load
from firmware_profiles.families.klipper.protocol import KlipperProtocol
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.states import LinkState, Status
from printctl.machine.link.streamer import Streamer
from sim.devices.families.klipper.printer import KlipperPrinter
from sim.gcode.motion.executed import ExecutedMotion
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import wired

PRINTER = load(Printer, "klipper_bioprinter")
START = (50.0, 50.0, 10.0)
HEADER = "SET_IDLE_TIMEOUT TIMEOUT=600\nSET_KINEMATIC_POSITION X=50 Y=50 Z=10\nG90\nM82\nG92 E0\n"
MOVES = 120


def job(extra: dict[int, str] | None = None, moves: int = MOVES) -> bytes:
    lines = []
    for i in range(moves):
        lines.append(f"G1 X{50 + i % 2 * 3.5:.3f} Y{50 + i % 40 * 0.25:.3f} E{0.01 * (i + 1):.4f}")
        lines += [extra[i]] if extra and i in extra else []
    return (HEADER + "G1 F600\n" + "\n".join(lines) + "\n").encode()


class SharedWire(SimTransport):
    """Another client, whose answers don't come here, sends ``text`` once E0.4 has left."""

    def __init__(self, text: bytes) -> None:
        super().__init__(KlipperPrinter(PRINTER, START), VirtualClock())
        self._text, self._swallow = text, 0

    def write(self, data: bytes) -> None:
        super().write(data)
        if b" E0.4000" in data and self._text:
            self._text, text = b"", self._text
            self._swallow = text.count(b"\n")
            super().write(text)

    def read(self, wait_s: float) -> bytes:
        data = super().read(wait_s)
        while self._swallow and b"ok\n" in data:
            data, self._swallow = data.replace(b"ok\n", b"", 1), self._swallow - 1
        return data


def streamer_on(wire: SharedWire, folder: Path, data: bytes, **wiring: Any) -> Streamer:
    return wired(wire, folder, data, PRINTER, protocol=KlipperProtocol(), **wiring)


def printed(folder: Path, text: bytes, data: bytes | None = None) -> tuple[Status, ExecutedMotion]:
    folder.mkdir(exist_ok=True)
    wire = SharedWire(text)
    status = streamer_on(wire, folder, data or job()).run()
    return status, wire.printer.executed()


@pytest.mark.parametrize(
    "text",
    ["G91", "M83", "M221 S50", "SET_GCODE_OFFSET X=2", "SET_GCODE_OFFSET Z=-2", "G92 X9", "G92 E5"]
    + ["SET_KINEMATIC_POSITION X=60"],
)
def test_what_makes_the_next_lines_other_than_the_job_says_ends_the_print_soon(tmp_path, text):
    status, made = printed(tmp_path, text.encode() + b"\n")
    assert status.state is LinkState.POSITION_UNKNOWN
    assert not status.position_known
    assert len(made.end) < MOVES - 20


def test_speed_and_heaters_of_another_client_are_taken_back(tmp_path):
    _, alone = printed(tmp_path / "alone", b"")
    status, made = printed(tmp_path / "other", b"M220 S30\nM140 S60\n")
    assert status.state is LinkState.DONE
    assert np.allclose(made.end[-1], alone.end[-1])
    alarms = read_journal(tmp_path / "other" / "journal.log").alarms
    assert any("bed is set to 60" in text for text in alarms)


@pytest.mark.parametrize(
    "text", ["SET_KINEMATIC_POSITION Z=60", "G92 Z60", "G92 E5", "SET_GCODE_OFFSET Z=-2"]
)
def test_place_renamed_in_a_pause_is_found_before_the_needle_is_lowered(tmp_path, text):
    """With Z called 38 mm higher the needle was driven 38 mm through the dish, and `done` said."""
    wire = SharedWire(b"")
    states: list[LinkState] = []

    def on_status(status: Status) -> None:
        if status.lines_done > MOVES // 4 and LinkState.PAUSING not in states:
            streamer.pause()
        if status.state is LinkState.PAUSED and LinkState.PAUSED not in states:
            wire._swallow = 1
            SimTransport.write(wire, text.encode() + b"\n")
            streamer.resume()
        states.append(status.state)

    streamer = streamer_on(wire, tmp_path, job(), on_status=on_status)
    status = streamer.run()
    assert LinkState.PAUSED in states
    assert status.state is LinkState.POSITION_UNKNOWN
    assert wire.printer.executed().end[:, 2].min() >= START[2] - 1e-6
