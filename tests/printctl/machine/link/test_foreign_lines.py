"""Commands from another program to the printer during a print."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firmware_profiles import Printer, load
from firmware_profiles.families.klipper.protocol import KlipperProtocol
from firmware_profiles.families.link_protocol import StrayOk
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from gcode.motion.executed import ExecutedMotion
from printctl.machine.control.board.connecting import protocol_for
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState, Status
from sim.devices.families.klipper_printer import KlipperPrinter
from sim.devices.families.marlin_printer import MarlinPrinter
from sim.devices.families.registry import simulated_printer
from tests.printctl.machine.link.fake_marlin import zigzag
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import PRINTER, START, gcode, wire, wired
from tests.printctl.machine.link.simulated import printed as printed_shared

OTHERS = "another program or noise wrote to this printer: 1 reply more than lines"


def started(sent: int = 30) -> MarlinProtocol:
    protocol = MarlinProtocol()
    protocol.load(zigzag(100), sent, sent)
    protocol.held = False
    protocol.go(0.0)
    protocol.take_output()
    return protocol


def test_second_ok_that_names_our_own_line_is_nobody_elses():
    """Seen on a real board: a token run twice, behind M410 without emergency parser."""
    protocol = started()
    protocol.held = True
    protocol.feed(b"ok N31 P15 B3\n", 0.1)
    assert protocol.feed(b"ok N31 P15 B3\n", 0.2) == [StrayOk(31, 0)]


@pytest.mark.parametrize(
    ("profile", "head"),
    [
        ("klipper_bioprinter", b"SET_KINEMATIC_POSITION X=50 Y=50 Z=10\n"),
        ("ender5_duet3_replistruder5", b"M302 P1\n"),
    ],
)
def test_another_program_s_line_on_other_boards_pauses_once_and_is_told(tmp_path, profile, head):
    facts, states = load(Printer, profile), list[LinkState]()

    class Meddled(SimTransport):
        writes = b"M105\n"

        def write(self, data: bytes) -> None:
            super().write(data)
            if b" E0.2" in data and self.writes:
                super().write(self.writes)
                self.writes = b""

    def on_status(status: Status) -> None:
        if status.state is LinkState.PAUSED:
            streamer.resume()
        states.append(status.state)

    data = gcode(200, head + b"G90\nM82\nG92 X50 Y50 Z10 E0\n")
    wire = Meddled(simulated_printer(facts)(facts, START), VirtualClock())
    protocol = protocol_for(facts, 0.05)
    streamer = wired(wire, tmp_path, data, facts, protocol=protocol, on_status=on_status)
    status = streamer.run()
    assert (status.state, status.position_known) == (LinkState.DONE, False), status
    assert states.count(LinkState.PAUSED) == 1
    assert OTHERS in status.message


# --- other programs' changes of modes and settings during a print on the simulated Marlin
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
    status, _ = printed_shared(gcode(MOVES), folder, wire)
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
    assert "may be in the print at Z 10.00 mm" in status.message
    assert made.end[-1, 0] < 300


def test_steps_that_another_program_changes_end_the_print(tmp_path):
    status, _ = shared(tmp_path, b"M92 E250\n")
    assert status.state is LinkState.POSITION_UNKNOWN
    assert "E has 250 steps/mm" in status.message
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

    status, _ = printed_shared(gcode(MOVES), tmp_path, wire, on_status=on_status, keep=kept)
    assert status.state is LinkState.STOPPED
    alarms = " ".join(read_journal(tmp_path / "journal.log").alarms)
    assert "waits for its own button to be pressed" in alarms


def test_heater_that_another_program_switches_on_is_set_back(tmp_path):
    wire = SharedWire(b"M140 S60\n", b" E0.07000 ")
    status, _ = printed_shared(gcode(MOVES), tmp_path, wire)
    assert status.state is LinkState.DONE
    assert wire.printer.machine.heat.bed.target_c == 0
    alarms = " ".join(read_journal(tmp_path / "journal.log").alarms)
    assert "the bed is set to 60 °C, but this print had set 0 °C" in alarms


@pytest.mark.parametrize(("celsius", "told"), [(37, False), (110, True)])
def test_heater_that_is_too_hot_before_the_first_line_is_refused(tmp_path, celsius, told):
    wire = SharedWire(b"", b" E0.07000 ")
    wire.printer.receive(b"M140 S%d\n" % celsius)
    status, _ = printed_shared(gcode(MOVES), tmp_path, wire)
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
    status, _ = printed_shared(b"M140 S30\n" + gcode(MOVES), tmp_path, wire)
    assert status.state is LinkState.DONE
    assert wire.times > 1
    assert wire.printer.machine.heat.bed.target_c == 30
    assert "is set to" not in " ".join(read_journal(tmp_path / "journal.log").alarms)


# --- other programs' commands during a pause on the simulated Marlin, then `resume`
JOB_Z_MM = 10.0


def resumed_after(folder: Path, text: bytes) -> tuple[Status, ExecutedMotion]:
    """Pause in mid-print, have another program write ``text``, resume."""
    shared, kept = wire(), list[Streamer]()
    states: list[LinkState] = []

    def on_status(status: Status) -> None:
        if status.state is LinkState.PRINTING and status.lines_done > 50 and not states:
            states.append(status.state)
            kept[0].pause()
        if status.state is LinkState.PAUSED and LinkState.PAUSED not in states:
            states.append(status.state)
            shared.printer.receive(text)
            kept[0].resume()
        elif status.state is LinkState.PAUSED and "job says" in status.message:
            kept[0].stop()

    status, _ = printed_shared(gcode(MOVES), folder, shared, on_status=on_status, keep=kept)
    assert LinkState.PAUSED in states
    return status, shared.printer.executed()


def test_a_renamed_height_ends_the_print_before_the_needle_is_lowered(tmp_path):
    status, made = resumed_after(tmp_path, b"G92 Z60\n")
    assert status.state is LinkState.POSITION_UNKNOWN, status
    assert not status.position_known
    assert made.end[:, 2].min() >= JOB_Z_MM - 1e-6
    assert made.end[-1, 2] > JOB_Z_MM + 1  # it still stands lifted


def test_a_renamed_place_keeps_the_print_paused(tmp_path):
    status, made = resumed_after(tmp_path, b"G92 X9\n")
    assert status.state is LinkState.STOPPED, status
    assert made.end[:, 2].min() >= JOB_Z_MM - 1e-6
    assert made.end[-1, 2] > JOB_Z_MM + 1


@pytest.mark.parametrize("text", [b"G91\n", b"M83\n", b"M221 S50\n", b""])
def test_modes_and_factors_are_taken_back(tmp_path, text):
    (tmp_path / "other").mkdir()
    status, made = resumed_after(tmp_path / "other", text)
    (tmp_path / "alone").mkdir()
    _, alone = resumed_after(tmp_path / "alone", b"")
    assert status.state is LinkState.DONE, status
    np.testing.assert_array_equal(made.end[-100:], alone.end[-100:])
    assert made.plunger_end[-1] == pytest.approx(alone.plunger_end[-1])
    assert made.end[:, 2].min() >= JOB_Z_MM - 1e-6


@pytest.mark.parametrize("text", [b"G92 E7\n", b"G92 E-7\n", b"G1 E9 F1200\n"])
def test_a_plunger_that_another_program_moved_or_renamed_isnt_driven_anywhere(tmp_path, text):
    status, made = resumed_after(tmp_path, text)
    assert status.state is LinkState.POSITION_UNKNOWN, status
    assert "the plunger is reported at E" in status.message
    behind = made.plunger_end.max() - made.plunger_end[-1]
    assert behind <= 0.1 + 0.003  # what the pause itself drew back


# --- another Klipper client's commands during a print, whose replies the link never receives
KLIPPER = load(Printer, "klipper_bioprinter")
KLIPPER_HEADER = (
    "SET_IDLE_TIMEOUT TIMEOUT=600\nSET_KINEMATIC_POSITION X=50 Y=50 Z=10\nG90\nM82\nG92 E0\n"
)
KLIPPER_MOVES = 120


def klipper_job(extra: dict[int, str] | None = None, moves: int = KLIPPER_MOVES) -> bytes:
    lines = []
    for i in range(moves):
        lines.append(f"G1 X{50 + i % 2 * 3.5:.3f} Y{50 + i % 40 * 0.25:.3f} E{0.01 * (i + 1):.4f}")
        lines += [extra[i]] if extra and i in extra else []
    return (KLIPPER_HEADER + "G1 F600\n" + "\n".join(lines) + "\n").encode()


class ClientsWire(SimTransport):
    """Another client, whose answers don't come here, sends ``text`` once E0.4 has left."""

    def __init__(self, text: bytes) -> None:
        super().__init__(KlipperPrinter(KLIPPER, START), VirtualClock())
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


def streamer_on(wire: ClientsWire, folder: Path, data: bytes, **wiring: Any) -> Streamer:
    return wired(wire, folder, data, KLIPPER, protocol=KlipperProtocol(), **wiring)


def printed_klipper(
    folder: Path, text: bytes, data: bytes | None = None
) -> tuple[Status, ExecutedMotion]:
    folder.mkdir(exist_ok=True)
    wire = ClientsWire(text)
    status = streamer_on(wire, folder, klipper_job()).run()
    return status, wire.printer.executed()


@pytest.mark.parametrize(
    "text",
    ["G91", "M83", "M221 S50", "SET_GCODE_OFFSET X=2", "SET_GCODE_OFFSET Z=-2", "G92 X9", "G92 E5"]
    + ["SET_KINEMATIC_POSITION X=60"],
)
def test_what_makes_the_next_lines_other_than_the_job_says_ends_the_print_soon(tmp_path, text):
    status, made = printed_klipper(tmp_path, text.encode() + b"\n")
    assert status.state is LinkState.POSITION_UNKNOWN
    assert not status.position_known
    assert len(made.end) < KLIPPER_MOVES - 20


def test_speed_and_heaters_of_another_client_are_taken_back(tmp_path):
    _, alone = printed_klipper(tmp_path / "alone", b"")
    status, made = printed_klipper(tmp_path / "other", b"M220 S30\nM140 S60\n")
    assert status.state is LinkState.DONE
    assert np.allclose(made.end[-1], alone.end[-1])
    alarms = read_journal(tmp_path / "other" / "journal.log").alarms
    assert any("bed is set to 60" in text for text in alarms)


@pytest.mark.parametrize(
    "text", ["SET_KINEMATIC_POSITION Z=60", "G92 Z60", "G92 E5", "SET_GCODE_OFFSET Z=-2"]
)
def test_place_renamed_in_a_pause_is_found_before_the_needle_is_lowered(tmp_path, text):
    """With Z called 38 mm higher the needle was driven 38 mm through the dish, and `done` said."""
    wire = ClientsWire(b"")
    states: list[LinkState] = []

    def on_status(status: Status) -> None:
        if status.lines_done > KLIPPER_MOVES // 4 and LinkState.PAUSING not in states:
            streamer.pause()
        if status.state is LinkState.PAUSED and LinkState.PAUSED not in states:
            wire._swallow = 1
            SimTransport.write(wire, text.encode() + b"\n")
            streamer.resume()
        states.append(status.state)

    streamer = streamer_on(wire, tmp_path, klipper_job(), on_status=on_status)
    status = streamer.run()
    assert LinkState.PAUSED in states
    assert status.state is LinkState.POSITION_UNKNOWN
    assert wire.printer.executed().end[:, 2].min() >= START[2] - 1e-6
