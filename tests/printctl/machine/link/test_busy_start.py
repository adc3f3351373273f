"""Start of a print on a machine that still moves, or is hotter than the set-up allows."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware_profiles import Printer, load
from firmware_profiles.families.link_protocol import LinkProtocol
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.errors import HandshakeError
from printctl.machine.link.families import protocol_for
from printctl.machine.link.start_checks import REST_LIMIT_S
from printctl.machine.link.states import LinkState, Status
from sim.devices.board.printer import SimulatedPrinter
from sim.devices.families.registry import simulated_printer
from tests.printctl.machine.link.fake_marlin import FakeMarlin, FakeTransport, zigzag
from tests.printctl.machine.link.layered import Script, played
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.test_streamer import job_of, streamer_of

START = (50.0, 50.0, 10.0)
HERE = {
    "generic_marlin": "G92 X50 Y50 Z10 E0\n",
    "ender5_duet3_replistruder5": "G92 X50 Y50 Z10 E0\n",
    "klipper_bioprinter": "SET_KINEMATIC_POSITION X=50 Y=50 Z=10\nG92 E0\n",
}


def begun(
    folder: Path, profile: str, before: str, declared: bool = True
) -> tuple[Status, Script, SimulatedPrinter, int]:
    """Print behind ``before`` of a former job; and the moves that were made before it."""
    changes = {"resets_on_connect": False}
    printer = load(Printer, profile).model_copy(update=changes)
    board, clock = simulated_printer(printer)(printer, START), VirtualClock()
    wire, script = SimTransport(board, clock), Script()
    wire.write((HERE[profile] + before).encode())
    protocol: LinkProtocol = protocol_for(printer, wire.quiet_s)
    job = (HERE[profile] if declared else "") + "G90\nM82\nG1 X51 Y50 Z10 F600\nM400\n"
    status = played(
        job.encode(), folder, wire, script, protocol=protocol, printer=printer
    )  # fmt: skip
    return status, script, board, before.count("G1")


@pytest.mark.parametrize("profile", HERE)
@pytest.mark.parametrize("feed", [600, 60])
def test_start_is_refused_while_a_former_job_moves(tmp_path, profile, feed):
    status, _, board, moves = begun(tmp_path, profile, f"G90\nG1 X150 F{feed}\n")
    assert (status.state, status.error) == (LinkState.FAILED, HandshakeError.__name__)
    assert status.lines_done == 0
    assert len(board.executed()) == moves
    assert ("at most 30" if feed == 60 else "X50.00 Y50.00 Z10.00") in status.message


@pytest.mark.parametrize("profile", ["generic_marlin", "ender5_duet3_replistruder5"])
def test_job_that_goes_by_the_printers_own_places_waits_until_it_stands(tmp_path, profile):
    status, script, board, _ = begun(tmp_path, profile, "G90\nG1 X80 F180\n", declared=False)
    assert status.state is LinkState.DONE, status
    assert any("waiting for it, up to 30 s" in one.message for one in script.seen)
    assert board.executed().end[-1].tolist() == [51.0, 50.0, 10.0]


@pytest.mark.parametrize("profile", HERE)
@pytest.mark.parametrize("off", ["", "M140 S0\n"])
def test_start_is_refused_while_the_bed_is_above_the_set_ups_limit(tmp_path, profile, off):
    status, _, board, _ = begun(tmp_path, profile, f"M140 S60\nM190 S58.7\n{off}")
    assert (status.state, status.error) == (LinkState.FAILED, HandshakeError.__name__)
    assert "the bed is at 58." in status.message
    assert "above 45 °C" in status.message
    assert len(board.executed()) == 0


class Driven(FakeMarlin):
    """Its card, or another program, drives it on."""

    def _reply(self, word: str, command: str) -> str:
        self.at["X"] += 0.05 if word == "M114" else 0.0
        return super()._reply(word, command)


class Busy(FakeMarlin):
    """It waits for a person, and says that it is busy; M400 is never answered."""

    def _reply(self, word: str, command: str) -> str:
        return "echo:busy: processing\n" if word == "M400" else super()._reply(word, command)


class BusyTransport(FakeTransport):
    """The board says once a second that it is busy."""

    def read(self, timeout: float) -> bytes:
        said = b"echo:busy: processing\n" * (self.clock.now() % 1.0 < 0.05)
        return super().read(timeout) or said


@pytest.mark.parametrize("printer", [Driven(), Busy()])
def test_machine_that_never_stands_is_waited_for_30_s_and_refused(tmp_path, printer):
    wire = (BusyTransport if isinstance(printer, Busy) else FakeTransport)(printer, VirtualClock())
    messages: list[str] = []
    streamer = streamer_of(
        job_of(zigzag(3)), wire, tmp_path, lambda status: messages.append(status.message)
    )
    status = streamer.run()
    assert (status.state, status.error) == (LinkState.FAILED, HandshakeError.__name__)
    assert REST_LIMIT_S < wire.clock.now() < REST_LIMIT_S + 5.0
    assert any("waiting for it, up to 30 s" in text for text in messages)
    assert not any(line.startswith("G1") for line in printer.executed)
