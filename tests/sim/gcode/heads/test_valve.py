"""Valve of a pneumatic head: switching, ink flow times, deposit positions."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from firmware_profiles import Printer, load
from sim.errors import DepositError
from sim.gcode.deposit.pneumatic import pneumatic_deposit
from sim.gcode.dry_run.run import DryRun, dry_run
from sim.gcode.heads import (
    BETWEEN,
    CLOSED,
    OPEN,
    as_plunger,
    flowing,
    read_with_valve,
    with_commands,
)
from sim.gcode.motion.executed import ExecutedMotion

PRINTER = load(Printer, "pneumatic_marlin")
HEAD = PRINTER.pneumatic
assert HEAD is not None
START = (100.0, 100.0, 10.0)


def of(printer: Printer = PRINTER, **changes: Any) -> Printer:
    return printer.model_copy(update={"dispenser": HEAD.model_copy(update=changes)})


def run(*lines: str, printer: Printer = PRINTER) -> DryRun:
    return dry_run("\n".join(lines).encode(), printer, START)


def states(found: DryRun) -> list[int]:
    assert found.valve is not None
    return found.valve.state.tolist()


@pytest.mark.parametrize(
    ("line", "state"),
    [
        ("M106 P0 S255", [OPEN]),
        ("M106 S255 P0 ; air", [OPEN]),
        ("M106 P0 S0", [CLOSED]),
        ("M106 P0 S128", [BETWEEN]),
        ("M106 P1 S255", []),
        ("M1066 P0 S255", []),
        ("; M106 P0 S255", []),
        ("G1 X101", []),
    ],
)
def test_only_the_profile_s_own_commands_switch_the_valve(line: str, state: list[int]) -> None:
    assert states(run("G90", line, "M400")) == state


LINE = ["M106 P0 S255", "G4 P50", "G1 X110 F600", "M400", "M106 P0 S0", "G4 P40"]


def test_ink_flows_from_the_opening_delay_to_the_closing_delay() -> None:
    printer = of(opening_delay_s=0.02, closing_delay_s=0.01)
    found = run("G0 X90 F6000", "M400", *LINE, "G0 X80", printer=printer)
    head = printer.pneumatic
    assert head is not None
    assert found.valve is not None
    ((begin, end),) = flowing(found.executed, found.program, found.valve, head)
    first, last = 1, 1
    assert begin == pytest.approx(found.executed.time_start[first] - 0.05 + 0.02)
    assert end == pytest.approx(found.executed.time_end[last] + 0.01)


def motion(times: list[tuple[float, float]]) -> ExecutedMotion:
    count = len(times)
    x = np.arange(count + 1.0)
    places = np.column_stack([x, 0 * x, 0 * x])
    start, end = np.array(times).T
    none = np.zeros(count)
    return ExecutedMotion(places[:-1], places[1:], none, none, start, end, np.arange(count))


def test_each_block_gets_what_flowed_in_its_time_and_the_rest_is_laid_standing() -> None:
    blocks = motion([(0, 1), (1, 3), (4, 5), (6, 7)])
    laid = as_plunger(blocks, np.array([[0.5, 4.5], [5.5, 5.75]]), 2.0)
    volume = laid.plunger_end - laid.plunger_start
    length = np.linalg.norm(laid.end - laid.start, axis=1)
    assert volume[length > 0].tolist() == [1.0, 4.0, 1.0, 0.0]
    assert volume[length == 0].tolist() == [2.0, 0.5]
    assert volume.sum() == pytest.approx(2.0 * 4.25)
    assert (laid.start[1:] == laid.end[:-1]).all()


def test_a_written_line_is_as_thick_as_flow_over_speed() -> None:
    text = "\n".join(["G0 Z5 F240", "M400", *LINE, "G0 Z20 F240"]).encode()
    found = dry_run(text, of(opening_delay_s=0.05), START)
    ink = pneumatic_deposit(found.executed, text, of(opening_delay_s=0.05), 1.0, 0.05)
    # 1 µL/s at 10 mm/s: 0.1 mm², and a little more for speeding up and down.
    assert ink.written_ul == pytest.approx(1.0, rel=0.02)
    across = ink.volume[:, :, ink.volume.shape[2] // 2].sum() / 255 * 0.05**2
    assert across == pytest.approx(0.1, rel=0.05)
    assert ink.style == "embedded"
    assert ink.standing_ul == pytest.approx(0.03, abs=5e-3)  # while it closes


def test_travels_leave_nothing_and_a_plunger_s_printer_is_refused() -> None:
    text = "\n".join(["M400", *LINE, "G0 Y130 F3000", "M400", *LINE[:2], "G1 X100 F600",
                      "M400", *LINE[4:]]).encode()  # fmt: skip
    found = dry_run(text, PRINTER, START)
    ink = pneumatic_deposit(found.executed, text, PRINTER, 1.0, 0.1)
    y = ink.origin_mm[1] + 0.1 * np.arange(ink.volume.shape[1])
    assert ink.volume[:, (y > 101) & (y < 129)].max() == 0
    assert ink.volume[:, y < 101].max() == 255
    with pytest.raises(DepositError, match="no pneumatic head"):
        pneumatic_deposit(found.executed, text, load(Printer, "generic_marlin"), 1.0, 0.1)
    with pytest.raises(DepositError, match="flow_ul_s"):
        pneumatic_deposit(found.executed, text, PRINTER, 0.0, 0.1)


def test_a_host_s_own_lines_and_moves_don_t_shift_the_valve() -> None:
    text = "\n".join(["G0 Z5 F240", "M400", *LINE, "G0 Y110 F3000", "M400", *LINE[:2],
                      "G1 X100 F600", "G1 Y112", *LINE[3:], "G0 Z20 F240"]).encode()  # fmt: skip
    found = dry_run(text, PRINTER, START).executed
    plain = pneumatic_deposit(found, text, PRINTER, 1.0, 0.05)
    shifted = replace(found, line=found.line + 7)
    moved = pneumatic_deposit(shifted, text, PRINTER, 1.0, 0.05)
    np.testing.assert_array_equal(moved.volume, plain.volume)
    # A pause: the needle goes up and comes back between two blocks.
    lift, at = np.array([0, 0, 20.0]), 3
    times = found.time_end[at - 1] + np.array([0.0, 1.0, 2.0])
    paused = ExecutedMotion(
        np.insert(found.start, [at, at], [found.start[at], found.start[at] + lift], axis=0),
        np.insert(found.end, [at, at], [found.start[at] + lift, found.start[at]], axis=0),
        np.insert(found.plunger_start, [at, at], 0.0),
        np.insert(found.plunger_end, [at, at], 0.0),
        np.insert(found.time_start + 3 * (np.arange(len(found)) >= at), [at, at], times[:2]),
        np.insert(found.time_end + 3 * (np.arange(len(found)) >= at), [at, at], times[1:]),
        np.insert(found.line, [at, at], -1),
    )
    resumed = with_commands(paused, read_with_valve(text, PRINTER, START)[0])
    assert resumed.line[at : at + 2].tolist() == [-1, -1]
    np.testing.assert_array_equal(np.delete(resumed.line, [at, at + 1]), found.line)


def test_a_motion_of_another_file_is_refused() -> None:
    text = "\n".join(LINE).encode()
    found = dry_run(text, PRINTER, START).executed
    with pytest.raises(DepositError, match="aren't of the same print"):
        pneumatic_deposit(found, text.replace(b"X110", b"X130"), PRINTER, 1.0, 0.05)
    with pytest.raises(DepositError, match="nothing moved"):
        nothing = dry_run(b"G90", PRINTER, START).executed
        pneumatic_deposit(nothing, text, PRINTER, 1.0, 0.05)
