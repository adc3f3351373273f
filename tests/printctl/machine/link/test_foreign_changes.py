"""Other programs' changes of modes and settings during a print on the simulated Marlin."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.states import LinkState, Status
from printctl.machine.link.streamer import Streamer
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.gcode.motion.executed import ExecutedMotion
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import PRINTER, START, gcode, printed

OTHERS = "another program or noise wrote to this printer: 1 answer more than lines"
MOVES = 240
TOKEN = b"M0118 E1 at"


class SharedWire(SimTransport):
    """Another program writes ``text`` once lines with each of ``after`` have left, in order."""

    def __init__(self, text: bytes, *after: bytes) -> None:
        super().__init__(MarlinPrinter(PRINTER, START), VirtualClock())
        self._after, self._text = list(after), text

    def write(self, data: bytes) -> None:
        super().write(data)
        if self._after and self._after[0] in data:
            self._after.pop(0)
            if not self._after:
                super().write(self._text)


def shared(folder: Path, text: bytes, *after: bytes) -> tuple[Status, ExecutedMotion]:
    wire = SharedWire(text, b" E0.07000 ", *after)
    status, _ = printed(gcode(MOVES), folder, wire)
    return status, wire.printer.executed()


@pytest.fixture(scope="module")
def alone(tmp_path_factory) -> ExecutedMotion:
    return shared(tmp_path_factory.mktemp("alone"), b"")[1]


@pytest.mark.parametrize(
    ("text", "named"),
    [(b"M221 S50\n", "flow factor is 50 %"), (b"M220 S50\n", "speed factor is 50 %")],
)
def test_what_another_program_sets_is_taken_back(tmp_path, alone, text, named):
    status, made = shared(tmp_path, text)
    assert status.state is LinkState.DONE
    assert OTHERS in status.message
    assert np.allclose(made.end[-1], alone.end[-1])
    alarms = " ".join(read_journal(tmp_path / "journal.log").alarms)
    assert named in alarms
    assert np.allclose(np.diff(made.plunger_end[-80:]), np.diff(alone.plunger_end[-80:]))
    lasted, meant = made.time_end[-1] - made.time_end[-80], alone.time_end[-1] - alone.time_end[-80]
    assert lasted < 1.1 * meant


@pytest.mark.parametrize("text", [b"M83\n", b"G91\n"])
def test_mode_that_is_noticed_before_the_next_line_is_taken_back(tmp_path, alone, text):
    """The position is right when the answer too many is noticed: behind a token, as it happens."""
    status, made = shared(tmp_path, text, TOKEN)
    assert status.state is LinkState.DONE
    assert OTHERS in status.message
    assert np.allclose(made.end[-1], alone.end[-1])
    assert made.plunger_end[-1] == pytest.approx(alone.plunger_end[-1])


def test_moves_that_lead_astray_are_dropped(tmp_path):
    """Each line then adds its places: the planner holds sixteen that lead out of the machine."""
    status, made = shared(tmp_path, b"G91\n")
    assert status.state is LinkState.POSITION_UNKNOWN
    assert "its motors were told to stop (M410)" in status.message
    assert "X is " in status.message
    assert "still be in the ink at Z 10.00 mm" in status.message
    assert made.end[-1, 0] < 300


def test_steps_that_another_program_changes_end_the_print(tmp_path):
    status, _ = shared(tmp_path, b"M92 E250\n")
    assert status.state is LinkState.POSITION_UNKNOWN
    assert "E makes 250 steps/mm" in status.message
    assert "M410" in status.message


class Waiting(SharedWire):
    """The board waits for somebody at its button; a stop is asked for 5 s later."""

    streamer: Streamer
    asked_s = 0.0

    def read(self, timeout: float) -> bytes:
        if not self._after and not self.asked_s and self.printer.machine.waits_for_user:
            self.asked_s = self.clock.now() + 5.0
        if self.asked_s and self.clock.now() > self.asked_s:
            self.streamer.stop()
            assert self.clock.now() < self.asked_s + 60.0, "the stop isn't over"
        return super().read(timeout)


def test_a_stop_ends_a_wait_for_a_person_at_the_printers_button(tmp_path):
    wire, kept = Waiting(b"M0\n", b" E0.07000 "), list[Streamer]()

    def on_status(_: Status) -> None:
        wire.streamer = kept[0]

    status, _ = printed(gcode(MOVES), tmp_path, wire, on_status=on_status, keep=kept)
    assert status.state is LinkState.STOPPED
    alarms = " ".join(read_journal(tmp_path / "journal.log").alarms)
    assert "waits for somebody to press its own button" in alarms


def test_heater_that_another_program_switches_on_is_set_back(tmp_path):
    wire = SharedWire(b"M140 S60\n", b" E0.07000 ")
    status, _ = printed(gcode(MOVES), tmp_path, wire)
    assert status.state is LinkState.DONE
    assert wire.printer.machine.heat.bed.target_c == 0
    alarms = " ".join(read_journal(tmp_path / "journal.log").alarms)
    assert "the bed is set to 60 °C, and this print had set 0 °C" in alarms


def test_heater_that_the_job_sets_stays(tmp_path):
    wire = SharedWire(b"M105\n", b" E0.07000 ")
    status, _ = printed(b"M140 S30\n" + gcode(MOVES), tmp_path, wire)
    assert status.state is LinkState.DONE
    assert wire.printer.machine.heat.bed.target_c == 30
    assert "is set to" not in " ".join(read_journal(tmp_path / "journal.log").alarms)


@pytest.mark.parametrize(("celsius", "told"), [(37, False), (110, True)])
def test_heater_that_is_too_hot_before_the_first_line_is_refused(tmp_path, celsius, told):
    wire = SharedWire(b"", b" E0.07000 ")
    wire.printer.receive(b"M140 S%d\n" % celsius)
    status, _ = printed(gcode(MOVES), tmp_path, wire)
    assert (status.state is LinkState.FAILED) == told
    assert (f"the bed is set to {celsius} °C, above 45 °C" in status.message) == told


def test_garbled_target_is_not_believed(tmp_path):
    class Garbled(SharedWire):
        """One answer in two tells another target of the bed."""

        times = 0

        def read(self, timeout: float) -> bytes:
            data = super().read(timeout)
            if b"B:" in data and b" /30.00" in data:
                self.times += 1
                if self.times % 2:
                    return data.replace(b" /30.00", b" /70.00")
            return data

    wire = Garbled(b"M105\n", b" E0.07000 ")
    status, _ = printed(b"M140 S30\n" + gcode(MOVES), tmp_path, wire)
    assert status.state is LinkState.DONE
    assert wire.times > 1
    assert wire.printer.machine.heat.bed.target_c == 30
    assert "is set to" not in " ".join(read_journal(tmp_path / "journal.log").alarms)
