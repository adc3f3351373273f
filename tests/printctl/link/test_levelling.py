"""Bed levelling and skew correction that a firmware has on, before the start and behind homing."""

from __future__ import annotations

import pytest

from firmware_profiles import Printer, load
from printctl.gate.firmware import differences
from printctl.link.clock import VirtualClock
from printctl.link.errors import HandshakeError
from printctl.link.journal import History, read_journal
from printctl.link.states import LinkState, Status
from sim.board.hardware import Board
from sim.families.marlin.printer import MarlinPrinter
from tests.printctl.link.layered import PRINTER, START, Script, played
from tests.printctl.link.sim_transport import SimTransport

SLOPE = 0.01
HOMED = b"G28\nG1 Z5 F300\nG1 X40 Y20 F3000\nG1 Z2\nG1 X90 F1200\nG1 Z6\nM400\n"
SWITCHED_OFF = "homing switched bed levelling on; switched off by M420 S0"


def printed(tmp_path, board: Board, dirty: bytes = b"") -> tuple[Status, MarlinPrinter, History]:
    printer = MarlinPrinter(PRINTER, START, board)
    transport = SimTransport(printer, VirtualClock())
    transport.write(dirty)
    while dirty and transport.read(1.0):
        pass
    status = played(HOMED, tmp_path, transport, Script())
    return status, printer, read_journal(tmp_path / "journal.log")


def heights(printer: MarlinPrinter) -> list[float]:
    """Where the motor of Z stood at the end of each of the job's moves, mm."""
    motion = printer.executed()
    return [round(float(z), 2) for z in motion.end[motion.line >= 0, 2]]


def test_levelling_that_homing_switches_on_is_off_before_the_next_move(tmp_path):
    status, printer, history = printed(tmp_path, Board(bed_slope=SLOPE, levels_after_homing=True))
    assert status.state is LinkState.DONE, status
    assert heights(printer) == [5.0, 5.0, 2.0, 2.0, 6.0]
    assert SWITCHED_OFF in history.alarms
    assert status.alarms == 1


def test_homing_that_leaves_levelling_off_is_no_alarm(tmp_path):
    status, printer, history = printed(tmp_path, Board(bed_slope=SLOPE))
    assert status.state is LinkState.DONE, status
    assert heights(printer) == [5.0, 5.0, 2.0, 2.0, 6.0]
    assert not history.alarms


def test_levelling_that_is_on_before_the_start_is_refused(tmp_path):
    status, printer, _ = printed(tmp_path, Board(bed_slope=SLOPE), b"M420 S1\n")
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


def test_skew_correction_of_nothing_is_no_difference():
    told = ["  M852 I0.000000 J0.000000 K0.000000 ; XY, XZ, YZ"]
    assert not differences({"M503 S0": told}, load(Printer, "marlin_avr"))
