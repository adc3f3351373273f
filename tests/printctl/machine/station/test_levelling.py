"""Bed levelling and skew correction active in the firmware: refused or switched off."""

from __future__ import annotations

from typing import Any

import pytest

from firmware_profiles import Printer, load
from printctl.checks.gate.firmware import differences
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.errors import HandshakeError
from printctl.machine.link.states import LinkState
from printctl.machine.station.idle_commands import IdleCommands
from printctl.machine.station.known_state import Knowledge
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.gcode.motion.hardware import Board
from tests.printctl.machine.link.layered import PRINTER, START, Script, layered, played
from tests.printctl.machine.link.sim_transport import SimTransport

SLOPE = 0.01


class Standing:
    """A standing printer that is told commands, as far as `IdleCommands` needs one."""

    position, temperatures = START, ()

    def __init__(self, printer: MarlinPrinter) -> None:
        self.transport, self.sent = SimTransport(printer, VirtualClock()), list[str]()

    def do(self, *commands: str) -> list[str]:
        self.sent += commands
        self.transport.write("".join(f"{one}\n" for one in commands).encode())
        said = b""
        while said.splitlines().count(b"ok") < len(commands):
            said += self.transport.read(1.0)
        return said.decode().splitlines()

    def look(self) -> None:
        self.do("M114")


def homed(board: Board) -> tuple[dict[str, Any], Standing]:
    """Home X and Y of a printer by hand; return the answer, and it."""
    standing = Standing(MarlinPrinter(PRINTER, START, board))
    hands = IdleCommands(standing, Knowledge(PRINTER))  # type: ignore[arg-type]
    return hands.requests["home"]({"axes": "xy"}), standing


def test_levelling_that_homing_by_hand_switches_on_is_off_again():
    answer, standing = homed(Board(bed_slope=SLOPE, levels_after_homing=True))
    assert "homing switched bed levelling on" in answer["message"]
    assert any("M420 S0" in line for line in standing.do("M503 S0"))


def test_homing_by_hand_that_leaves_levelling_off_sets_nothing():
    answer, standing = homed(Board(bed_slope=SLOPE))
    assert not answer["message"]
    assert not any(one.startswith("M420") for one in standing.sent)


def test_levelling_that_is_on_before_the_start_is_refused(tmp_path):
    printer = MarlinPrinter(PRINTER, START, Board(bed_slope=SLOPE))
    transport = SimTransport(printer, VirtualClock())
    transport.write(b"M420 S1\n")
    while transport.read(1.0):
        pass
    status = played(layered(1, 10), tmp_path, transport, Script())
    assert (status.state, status.error) == (LinkState.FAILED, HandshakeError.__name__)
    assert "bed levelling is on (M420 S1)" in status.message
    assert len(printer.executed()) == 0


@pytest.mark.parametrize(
    ("line", "factors"),
    [
        ("  M852 I0.010000 J0.000000 K-0.002000 ; XY, XZ, YZ", "I0.010000 K-0.002000"),
        ("  M852 I0.010000 ; XY", "I0.010000"),
    ],
)
def test_skew_correction_is_refused_with_its_factors(line, factors):
    (found,) = differences({"M503 S0": [line]}, load(Printer, "marlin_avr"))
    assert f"skew correction is on (M852 {factors})" in found.what
    assert not found.reset
    assert not found.tolerated
