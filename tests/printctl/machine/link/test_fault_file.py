"""Planned faults of the simulated printer: each ends a print in its documented state."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from firmware_profiles import Printer, load
from printctl.machine.link import LinkState, resume_print, start_print
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.errors import PortLost
from printctl.machine.link.families import protocol_for
from printctl.machine.link.states import Status
from sim.devices.board.controller import FaultPlan
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.devices.families.registry import simulated_printer
from sim.devices.faults import Fault, FaultFile
from sim.gcode.motion.executed import ExecutedMotion
from tests.printctl.machine.link.simulated import PRINTER, START, gcode, same_motion, wired
from tests.printctl.machine.link.simulated_transport import SimulatedTransport

REPO = Path(__file__).parents[4]
UNKNOWN = "position_unknown"
HEADER = b"M302 P1\nG90\nM82\nM85 S600\nM140 S37\nM109 S40\nG92 X50 Y50 Z10 E0\n"


def printed(data: bytes, folder: Path, faults: dict) -> tuple[Status, SimulatedTransport]:
    file = FaultFile.model_validate(faults)
    printer, clock = MarlinPrinter(PRINTER, START, faults=file.at), VirtualClock()
    transport = SimulatedTransport(printer, clock, file, np.random.default_rng(file.seed))
    return wired(transport, folder, data).run(), transport


def heaters(transport: SimulatedTransport) -> tuple[float, float]:
    machine = transport.printer.machine
    return machine.heat.hotend.target_c, machine.heat.bed.target_c


@pytest.mark.parametrize(
    "fault",
    [
        {"fault": "drop_ok", "line": 60},
        {"fault": "delay", "line": 60, "seconds": 3.0},
        {"fault": "noise", "line": 60, "rate": 0.05, "length_bytes": 400},
        {"fault": "noise", "time_s": 30.0, "rate": 1.0, "length_bytes": 20},
    ],
)
def test_faults_of_the_cable_are_got_over(tmp_path, fault):
    status, transport = printed(gcode(300, HEADER), tmp_path, {"seed": 3, "at": [fault]})
    assert status.state is LinkState.DONE, status
    clean = printed(gcode(300, HEADER), tmp_path, {})[1]
    assert same_motion(transport.printer.executed(), clean.printer.executed())


@pytest.mark.parametrize(
    ("fault", "state", "word"),
    [
        ({"fault": "reset"}, LinkState.POSITION_UNKNOWN, "reset"),
        ({"fault": "kill"}, LinkState.KILLED, "halted itself"),
        ({"fault": "runaway"}, LinkState.KILLED, "Thermal Runaway"),
    ],
)
@pytest.mark.parametrize("moment", [{"line": 100}, {"time_s": 40.0}, {"bytes": 5000}])
def test_faults_of_the_board_end_as_documented_with_heaters_off(
    tmp_path, fault, moment, state, word
):
    status, transport = printed(gcode(2000, HEADER), tmp_path, {"at": [fault | moment]})
    assert (status.state, status.position_known) == (state, False)
    assert word in status.message
    assert heaters(transport) == (0, 0)
    assert 0 < status.lines_done < 2000
    known_after = transport.clock.now() - transport.printer.now
    assert abs(known_after) < 0.5


def moments_of(printer: MarlinPrinter, *names: str) -> list[float]:
    """When these methods of the printer are called, on its clock."""
    moments: list[float] = []

    def noting(method):
        def noted(*given: object) -> None:
            moments.append(printer.now)
            method(*given)

        return noted

    for name in names:
        setattr(printer, name, noting(getattr(printer, name)))
    return moments


@pytest.mark.parametrize(
    ("profile", "header", "fault", "states"),
    [
        ("ender5_duet3_replistruder5", b"M302 P1\n", "reset", {"failed", "position_unknown"}),
        ("ender5_duet3_replistruder5", b"M302 P1\n", "kill", {"killed"}),
        ("ender5_duet3_replistruder5", b"M302 P1\n", "runaway", {"killed"}),
        ("klipper_bioprinter", b"SET_KINEMATIC_POSITION X=50 Y=50 Z=10\n", "reset", {UNKNOWN}),
        ("klipper_bioprinter", b"SET_KINEMATIC_POSITION X=50 Y=50 Z=10\n", "kill", {"killed"}),
        ("klipper_bioprinter", b"SET_KINEMATIC_POSITION X=50 Y=50 Z=10\n", "runaway", {"killed"}),
    ],
)
def test_faults_of_other_boards_end_as_documented_too(tmp_path, profile, header, fault, states):
    facts = load(Printer, profile)
    printer, clock = simulated_printer(facts)(facts, START), VirtualClock()
    printer.plan = FaultPlan([Fault(fault=fault, line=60)])
    transport = SimulatedTransport(printer, clock)
    ended = moments_of(printer, "reset", "kill")
    data = gcode(2000, header + b"G90\nM82\nM140 S37\nM109 S40\nG92 X50 Y50 Z10 E0\n")
    status = wired(transport, tmp_path, data, facts, protocol=protocol_for(facts, 0.05)).run()
    assert status.state in states, status
    assert not status.position_known
    assert clock.now() - ended[-1] < 10.0
    assert heaters(transport) == (0, 0)


def test_endstop_that_is_never_found_ends_as_killed_before_the_first_move(tmp_path):
    fault = {"fault": "endstop_stuck", "time_s": 0, "axis": "x", "stuck": "open"}
    data = gcode(50, HEADER + b"G28 X\n")
    status, transport = printed(data, tmp_path, {"at": [fault]})
    assert status.state is LinkState.KILLED
    assert "Homing Failed" in status.message or "halted" in status.message
    assert heaters(transport) == (0, 0)
    assert status.lines_done < len(HEADER.splitlines()) + 1


def test_pulled_cable_ends_as_failed_and_the_firmware_switches_off(tmp_path):
    fault = {"fault": "unplug", "line": 100}
    status, transport = printed(gcode(2000, HEADER), tmp_path, {"at": [fault]})
    assert (status.state, status.error) == (LinkState.FAILED, "PortLost")
    with pytest.raises(PortLost):
        transport.write(b"M105\n")
    printer = transport.printer
    printer.finish()
    printer.advance(605.0)
    assert printer.dead
    assert heaters(transport) == (0, 0)


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")
def test_print_goes_on_exactly_when_the_cable_is_plugged_in_again(tmp_path, profile):
    (tmp_path / "faults.yaml").write_text(
        "noise: 0.0002\nat: [{fault: unplug, line: 400, back_after_s: 0.3}]\n"
    )
    job, record, port = (tmp_path / name for name in ("job.gcode", "moved.npz", "port"))
    job.write_bytes(gcode(1000))
    words = ["--printer", profile, "--start", "50,50,10"]
    words += ["--faults", str(tmp_path / "faults.yaml"), "--link", str(port)]
    process = subprocess.Popen(
        [sys.executable, "-m", "sim", *words, "--record", str(record)],
        cwd=REPO,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout.readline().strip() == str(port)
        outcome = start_print(job, profile, str(port), tmp_path / "run").wait(300)
        assert (outcome.state, outcome.error) == (LinkState.FAILED, "PortLost")
        for _ in range(100):
            if port.is_symlink():
                break
            subprocess.run(["sleep", "0.05"], check=True)
        outcome = resume_print(tmp_path / "run").wait(300)
        assert outcome.state is LinkState.DONE, outcome
    finally:
        process.terminate()
        process.wait(300)
        process.stdout.close()
    moved = ExecutedMotion.load(record)
    assert len(moved) == 1000
    assert moved.plunger_end[-1] == pytest.approx(3.5, abs=1e-4)
