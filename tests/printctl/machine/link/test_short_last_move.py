"""Ends whose motors stand some steps off: a last move too short to be made, and a fault."""

from __future__ import annotations

import pytest

from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.states import LinkState
from tests.printctl.machine.link.fake_marlin import FakeMarlin, FakeTransport, zigzag
from tests.printctl.machine.link.simulated import PRINTER, gcode, printed, wire
from tests.printctl.machine.link.test_streamer import job_of, streamer_of


@pytest.mark.parametrize("moves", [3, 40])
def test_last_move_below_the_firmwares_least_steps_is_no_renamed_place(tmp_path, moves):
    """Seen on a real Marlin: 5 steps of X and Y short of the place that it tells."""
    last = 50 + (moves - 1) % 2 * 3.5
    status, _ = printed(gcode(moves) + b"G1 X%.4f\n" % (last + 0.0625), tmp_path, wire())
    assert status.state is LinkState.DONE
    assert status.position_known


@pytest.mark.parametrize(("axis", "steps"), [("X", 4), ("Z", 6), ("X", -4), ("Z", -6)])
def test_motors_some_steps_off_behind_a_long_last_move_are_not_done(tmp_path, axis, steps):
    class Off(FakeMarlin):
        def _do(self, command: str) -> bytes:
            if command.startswith(last):
                self.renamed_mm[axis] -= steps / {"X": 80, "Z": 400}[axis]
            return super()._do(command)

    job = zigzag(60)
    last = job[-1].decode()
    for printer, state in ((FakeMarlin(), LinkState.DONE), (Off(), LinkState.POSITION_UNKNOWN)):
        folder = tmp_path / state
        folder.mkdir()
        transport = FakeTransport(printer, VirtualClock())
        assert streamer_of(job_of(job), transport, folder).run().state is state
    checkpoint = read_journal(folder / "journal.log").checkpoint
    assert checkpoint is not None
    assert "plunger isn't compared" in checkpoint["compared"]


@pytest.mark.parametrize("bed", [True, False])
def test_a_printer_without_bed_is_not_told_to_switch_it_off(tmp_path, monkeypatch, bed):
    bare = PRINTER.model_copy(update={"safe_state_on": ()})
    monkeypatch.setattr("tests.printctl.machine.link.test_streamer.load", lambda *_: bare)

    class Bare(FakeMarlin):
        def _reply(self, word: str, command: str) -> str:
            said = super()._reply(word, command)
            return said if bed else said.replace(" B:21.00 /0.00", "").replace(" B@:0", "")

    printer = Bare()
    streamer = streamer_of(
        job_of([*zigzag(60), *[b"M105"] * 3000]),
        FakeTransport(printer, VirtualClock()),
        tmp_path,
        lambda status: streamer.stop() if status.lines_done > 10 else None,
    )
    assert streamer.run().state is LinkState.STOPPED
    assert ("M140 S0" in printer.numbered) is bed
