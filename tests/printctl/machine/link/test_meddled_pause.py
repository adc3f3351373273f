"""Other programs' commands during a pause on the simulated Marlin, then `resume`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from printctl.machine.link.states import LinkState, Status
from printctl.machine.link.streamer import Streamer
from sim.gcode.motion.executed import ExecutedMotion
from tests.printctl.machine.link.simulated import gcode, printed, wire

MOVES = 240
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

    status, _ = printed(gcode(MOVES), folder, shared, on_status=on_status, keep=kept)
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
    assert "the plunger is told at E" in status.message
    behind = made.plunger_end.max() - made.plunger_end[-1]
    assert behind <= 0.1 + 0.003  # what the pause itself drew back
