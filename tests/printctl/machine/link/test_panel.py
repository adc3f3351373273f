"""Prints whose flow or speed somebody changes at the printer's own panel."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from firmware_profiles import Printer, load
from printctl.machine.control.board.standstill import MODEL_ERROR
from printctl.machine.control.printing.factors import LATE_SHARE, _wire_s
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.job.care import Care
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState, Status
from sim.devices.board.printer import SimulatedPrinter
from sim.devices.families.registry import simulated_printer
from sim.devices.faults import Fault
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import layered
from tests.printctl.machine.link.protocols import made_protocol
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import START, wired

JOB = layered(3, 60).replace(b"M85 S600\n", b"")
CARE = Care(checkpoint_s=0.0)


class Panel:
    """A print on a simulated printer, on whose panel something is set at a line of the job."""

    def __init__(
        self, folder: Path, firmware: str, line: int, *faults: Fault, **percents: float
    ) -> None:
        facts = load(Printer, "generic_marlin").model_copy(
            update={"firmware": firmware, "resets_on_connect": False}
        )
        self.printer: SimulatedPrinter = simulated_printer(facts)(facts, START, faults=faults)
        self.transport = SimTransport(self.printer, VirtualClock())
        self.line, self.percents, self.pauses = line, percents, list[Status]()
        self.when_held = False
        self.streamer: Streamer = wired(
            self.transport,
            folder,
            parse_job(JOB, "test.gcode", facts),
            facts,
            CARE,
            protocol=made_protocol(firmware),
            on_status=self._on_status,
        )

    def _on_status(self, status: Status) -> None:
        held = self.when_held and status.state is LinkState.PAUSED
        if (status.lines_done >= self.line or held) and self.percents:
            motion = self.printer.machine.motion
            for name, percent in self.percents.items():
                motion.modal[name] = percent
            self.percents = {}
            self.printer.machine.set_flow()
        if status.state is LinkState.PAUSED:
            self.pauses.append(status)
            self.streamer.resume()

    def run(self) -> Status:
        return self.streamer.run()

    def percent(self, name: str) -> float:
        return float(self.printer.machine.motion.modal[name][0])


@pytest.mark.parametrize("firmware", ["marlin", "reprapfirmware"])
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("flow_percent", "the flow factor is 50 % (M221)"),
        ("speed_percent", "the speed factor is 50 % (M220)"),
    ],
)
def test_a_factor_set_at_the_panel_pauses_the_print_at_the_next_checkpoint(
    firmware, name, words, tmp_path
):
    panel = Panel(tmp_path, firmware, 80, **{name: 50.0})
    status = panel.run()
    [pause] = panel.pauses
    assert words in pause.message, pause.message
    assert "changed at the printer's panel" in pause.message
    assert "between line 66 and line 132 of test.gcode" in pause.message, pause.message
    assert panel.percent(name) == 100.0  # the rest is printed as it was checked
    [alarm] = read_journal(tmp_path / "journal.log").alarms  # slow moves are no standstill
    assert words in alarm
    assert status.state is LinkState.DONE
    assert words in status.message
    assert not status.proved  # exit code 1


def test_a_factor_set_behind_the_last_checkpoint_is_found_at_the_end(tmp_path):
    panel = Panel(tmp_path, "marlin", 195, flow_percent=69.0)
    status = panel.run()
    assert panel.pauses == []
    assert "the flow factor is 69 % (M221)" in status.message
    assert (status.state, status.position_known, status.proved) == (LinkState.DONE, True, False)


def test_a_factor_set_in_a_pause_is_set_back_before_the_needle_is_lowered(tmp_path):
    panel = Panel(tmp_path, "marlin", 10**6, flow_percent=150.0)
    panel.when_held = True
    panel.streamer.pause()
    status = panel.run()
    assert panel.percent("flow_percent") == 100.0
    [alarm] = read_journal(tmp_path / "journal.log").alarms
    assert "150 % (M221), changed at the printer's panel" in alarm
    assert "while the print was held; set back (M221 S100)" in alarm
    assert status.proved  # nothing was printed by it


def test_a_board_that_stood_still_is_told_once_and_its_print_goes_on(tmp_path):
    """The time that it stood makes no moves slow: no second alarm, no pause."""
    stall = Fault(fault="stall", line=80, seconds=20.0)
    panel = Panel(tmp_path, "marlin", 10**6, stall)
    status = panel.run()
    [alarm] = read_journal(tmp_path / "journal.log").alarms
    assert "the needle stopped while extruding, for" in alarm
    assert (panel.pauses, status.proved) == ([], True)


def test_moves_slower_than_planned_pause_a_print_whose_firmware_tells_no_factor(
    tmp_path, monkeypatch
):
    panel = Panel(tmp_path, "marlin", 80, speed_percent=20.0)
    monkeypatch.setattr(
        "printctl.machine.control.position.firmware.panel_questions", lambda printer: ()
    )
    status = panel.run()
    assert "the moves took" in panel.pauses[0].message, panel.pauses
    assert "were planned" in status.message


def test_a_print_without_changes_is_proved(tmp_path):
    status = Panel(tmp_path, "marlin", 10**6).run()
    assert (status.state, status.proved, status.error) == (LinkState.DONE, True, "")


def test_lines_that_the_wire_holds_up_aren_t_slowed_at_the_panel() -> None:
    """1200 lines of 0.05 mm took 11.44 s on a real Marlin at 115200 Bd, planned to take 5 s."""
    lines = [f"G1 X{100 + 0.05 * k:.3f} Y100.125 E{0.0001 * k:.5f}".encode() for k in range(1200)]
    run = SimpleNamespace(
        printer=load(Printer, "generic_marlin"),
        job=SimpleNamespace(lines=lines),
        progress=SimpleNamespace(done=len(lines)),
    )
    assert 11.44 / (1 + MODEL_ERROR + LATE_SHARE) < _wire_s(run, 0) < 1.5 * 11.44
