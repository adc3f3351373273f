"""Several heads, and valves of pneumatic ones: reader, simulation, firmwares, deposits."""

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from design.toolpath import Toolpath
from design.toolpath.embedded import EmbeddedOptions
from design.toolpath.fresh import FreshOptions
from design.toolpath.gcode import GcodeOptions, write_gcode
from firmware_profiles import Head, Offset, Printer, Syringe, load
from gcode.deposit.lay import Deposit, deposit
from gcode.dry_run.run import DryRun, dry_run
from gcode.errors import DepositError
from gcode.heads import (
    as_plunger,
    flowing,
    read_with_valve,
    with_commands,
)
from gcode.motion.executed import ExecutedMotion
from gcode.program.gcode import read_gcode
from gcode.program.valve import BETWEEN, CLOSED, OPEN
from gcode.reading.file import read_file
from sim.devices.families.klipper_printer import KlipperPrinter
from sim.devices.families.marlin_printer import MarlinPrinter
from sim.devices.families.reprapfirmware_printer import DuetPrinter
from tests.design.toolpath.plans import embedded_toolpath, fresh_toolpath
from tests.design.toolpath.shapes import as_solid, block, random_tree, upright
from tests.gcode.air_ink import pneumatic_deposit

TWO = load(Printer, "two_syringe_marlin")
HEADER = b"G21\nG90\nM82\nM302 P1\nM218 T1 X0 Y0 Z0\n"
JOB = (
    HEADER
    + b"T0 S1\nG92 X0 Y0 Z40 E0\nM400\nM280 P1 S90\nM280 P0 S10\n"
    + b"G1 Z10 F300\nG1 X10 E1 F600\nG1 E0.9 F60\nG1 Z40 F300\n"
    + b"M400\nM280 P0 S90\nT1 S1\nG92 E0\nM280 P1 S10\n"
    + b"G0 X20 F600\nG1 Z10 F300\nG1 X30 E2 F600\nG1 E1.9 F60\nG1 Z40 F300\n"
    + b"M400\nM280 P1 S90\nT0 S1\nG92 E0.9\nM280 P0 S10\n"
    + b"G1 Z10 F300\nG1 E1 F60\nG1 X40 E1.5 F600\nM400\n"
)


def codes(gcode, printer=TWO):
    # None of these files ends with a lift.
    codes = {finding.code for finding in dry_run(gcode, printer, (0, 0, 40)).findings}
    return codes - {"left_down"}


def sent(printer, gcode):
    said = b"".join(printer.exchange(line) for line in gcode.splitlines(keepends=True))
    printer.finish()
    return said


def test_each_head_s_plunger_is_counted_by_itself():
    program = read_gcode(JOB, (0, 0, 40), heads=2)
    last = {k: program.of_head(k).plunger[-1] for k in (0, 1)}
    assert last == pytest.approx({0: 1.5, 1: 1.9})
    assert program.pushed.sum() == pytest.approx(3.4)


def test_dry_run_and_simulated_printer_agree_block_by_block():
    run = dry_run(JOB, TWO, (0, 0, 40)).executed
    printer = MarlinPrinter(TWO, (0, 0, 40))
    sent(printer, JOB)
    done = printer.executed()
    assert done.tool.tolist() == run.tool.tolist()
    for name in ("start", "end", "plunger_start", "plunger_end"):
        np.testing.assert_allclose(getattr(done, name), getattr(run, name), atol=1e-9)
    for head, travel in ((0, 1.5), (1, 1.9)):
        rows = done.tool == head
        assert done.plunger_end[rows][-1] == pytest.approx(travel, abs=1e-3)


def test_a_head_s_own_steps_count_for_its_plunger():
    heads = (TWO.heads[0], TWO.heads[1].model_copy(update={"plunger_steps_per_mm": 3200.0}))
    unequal = TWO.model_copy(update={"heads": heads})
    printer = MarlinPrinter(unequal, (0, 0, 40))
    sent(printer, JOB)
    done = printer.executed()
    steps = int(printer.machine.motion.planner["plungers"][0, 1])
    assert steps == round(1.9 * 3200)
    assert done.plunger_end[done.tool == 1][-1] == pytest.approx(1.9)


@pytest.mark.slow
def test_the_ink_of_each_head_lies_where_its_own_tip_was():
    run = dry_run(JOB, TWO, (0, 0, 40)).executed
    of_right = run.of_head(1, TWO.heads[1].offset_mm.mm)
    laid = deposit(of_right, 10.0, 0.5, style="embedded")
    low, high = laid.bounds_mm
    assert low[0] < 60 < high[0]  # 20 + 40
    assert low[0] < 70 < high[0]
    assert not low[0] < 20


def test_a_correct_job_has_no_finding():
    assert codes(JOB) == set()


@pytest.mark.parametrize(
    ("wrong", "right", "sort"),
    [
        (b"M218 T1 X40 Y0 Z0", b"M218 T1 X0 Y0 Z0", "offset_twice"),
        (b"M105", b"M218 T1 X0 Y0 Z0", "offset_unknown"),
        (b"M218 T1 X0 Y0", b"M218 T1 X0 Y0 Z0", "offset_unknown"),
        (b"T2 S1", b"T1 S1", "no_such_head"),
        (b"M105", b"T0 S1\nG92 X0 Y0 Z40 E0", "head_not_chosen"),
        (b"T1 S1\nM105\n", b"T1 S1\nG92 E0\n", "plunger_not_counted"),
        (b"T1 S1\nG92 X0\n", b"T1 S1\nG92 E0\n", "plunger_not_counted"),
    ],
)
def test_what_a_firmware_would_do_wrong_is_found(wrong, right, sort):
    assert right in JOB
    assert sort in codes(JOB.replace(right, wrong, 1))


def test_marlin_s_own_offset_shifts_the_frame_and_moves_a_homed_carriage():
    printer = MarlinPrinter(TWO, (10, 0, 40))
    sent(printer, b"M302 P1\nM218 T1 X40 Y0 Z0\nT1 S1\n")
    assert b"X:50.00" in sent(printer, b"M114\n")
    sent(printer, b"G1 X50 Y1 F600\n")
    assert printer.executed().end[-1].tolist() == [10.0, 1.0, 40.0]
    printer = MarlinPrinter(TWO, (10, 0, 40))
    sent(printer, b"G28\nG1 X100 Y0 Z5 F3000\nM218 T1 X40 Y0 Z0\nT1\nM400\n")
    assert printer.executed().end[-1].tolist() == [60.0, 0.0, 5.0]
    assert b"X:100.00" in sent(printer, b"M114\n")


def test_raised_heads_are_followed_and_their_tips_known():
    run = dry_run(JOB, TWO, (0, 0, 40))
    program, heads = run.program, run.heads
    writes = program.pushed > 0.5
    for row in np.flatnonzero(writes).tolist():
        active = int(program.tool[row])
        assert not heads.raised[row, active]
        assert heads.raised[row, 1 - active]
        idle = heads.tips(program, 1 - active)[row]
        assert idle[:, 2].min() == pytest.approx(10 + 25)
    right = heads.tips(program, 1)
    assert (right[:, 1, 0] - program.target[:, 0] == 40).all()


def test_duet_moves_nothing_but_shifts_places_by_its_tool_s_offset():
    heads = tuple(
        head.model_copy(update={"select": f"T{k} P0"}) for k, head in enumerate(TWO.heads)
    )
    duet = TWO.model_copy(update={"heads": heads, "firmware": "reprapfirmware"})
    printer = DuetPrinter(duet, (0, 0, 40))
    sent(printer, b"M302 P1\nG92 X0 Y0 Z40 E0\nG10 P1 X40 Y0 Z0\nT1 P0\nG1 X50 F600\nM400\n")
    assert printer.executed().end[-1].tolist() == [10.0, 0.0, 40.0]
    job = JOB.replace(b"M218 T1 X0 Y0 Z0", b"G10 P0 X0 Y0 Z0\nG10 P1 X0 Y0 Z0")
    job = job.replace(b" S1\n", b" P0\n")
    assert codes(job, duet) == set()
    assert "offset_unknown" in codes(job.replace(b"G10 P0 X0 Y0 Z0\n", b""), duet)


def test_klipper_counts_anew_for_each_extruder():
    names = ("ACTIVATE_EXTRUDER EXTRUDER=extruder", "ACTIVATE_EXTRUDER EXTRUDER=extruder1")
    klipper = load(Printer, "klipper_bioprinter").model_copy(
        update={
            "heads": tuple(
                head.model_copy(update={"select": name})
                for head, name in zip(TWO.heads, names, strict=True)
            )
        }
    )
    file = read_file(b"%b\nT0\n" % names[1].encode(), klipper)
    assert file.in_g_code == b"T1\nT0"
    assert file.others[0][1].code == "ACTIVATE_EXTRUDER"
    printer = KlipperPrinter(klipper, (0, 0, 40))
    sent(printer, b"SET_KINEMATIC_POSITION X=0 Y=0 Z=40\nG1 E3 F60\n%b\nM400\n" % names[1].encode())
    assert b"E:0.000" in sent(printer, b"M114\n")
    sent(printer, b"G1 E1 F60\nM400\n")
    done = printer.executed()
    assert done.plunger_end[done.tool == 1][-1] == pytest.approx(1.0)
    assert done.plunger_end[done.tool == 0][-1] == pytest.approx(3.0)


def test_profiles_of_several_heads_are_held_to_their_rules():
    with pytest.raises(ValueError, match="first one's offset_mm"):
        Printer.model_validate(_with(TWO, 0, offset_mm={"x": 1}))
    with pytest.raises(ValueError, match="choose head 1"):
        Printer.model_validate(_with(TWO, 1, select="T0 S1"))
    with pytest.raises(ValueError, match="raises and lowers"):
        Head(name="a", select="T0", raised_mm=3)
    with pytest.raises(ValueError, match="two values"):
        Head(name="a", select="T0", raised_mm=3, raises="M280 P0 S1", lowers="M280 P0 S1")
    assert Offset(x=1).mm == (1, 0, 0)


def _with(printer, number, **changes):
    data = printer.model_dump(mode="json")
    data["heads"][number] |= changes
    return data


# Valve: switching, flow times, where ink lies


PNEUMATIC = load(Printer, "pneumatic_marlin")
HEAD = PNEUMATIC.pneumatic
assert HEAD is not None
VALVE_START = (100.0, 100.0, 10.0)


def of(printer: Printer = PNEUMATIC, **changes: Any) -> Printer:
    return printer.model_copy(update={"dispenser": HEAD.model_copy(update=changes)})


def run(*lines: str, printer: Printer = PNEUMATIC) -> DryRun:
    return dry_run("\n".join(lines).encode(), printer, VALVE_START)


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
    found = dry_run(text, of(opening_delay_s=0.05), VALVE_START)
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
    found = dry_run(text, PNEUMATIC, VALVE_START)
    ink = pneumatic_deposit(found.executed, text, PNEUMATIC, 1.0, 0.1)
    y = ink.origin_mm[1] + 0.1 * np.arange(ink.volume.shape[1])
    assert ink.volume[:, (y > 101) & (y < 129)].max() == 0
    assert ink.volume[:, y < 101].max() == 255
    with pytest.raises(DepositError, match="no pneumatic head"):
        pneumatic_deposit(found.executed, text, load(Printer, "generic_marlin"), 1.0, 0.1)
    with pytest.raises(DepositError, match="flow_ul_s"):
        pneumatic_deposit(found.executed, text, PNEUMATIC, 0.0, 0.1)


def test_a_host_s_own_lines_and_moves_don_t_shift_the_valve() -> None:
    text = "\n".join(["G0 Z5 F240", "M400", *LINE, "G0 Y110 F3000", "M400", *LINE[:2],
                      "G1 X100 F600", "G1 Y112", *LINE[3:], "G0 Z20 F240"]).encode()  # fmt: skip
    found = dry_run(text, PNEUMATIC, VALVE_START).executed
    plain = pneumatic_deposit(found, text, PNEUMATIC, 1.0, 0.05)
    shifted = replace(found, line=found.line + 7)
    moved = pneumatic_deposit(shifted, text, PNEUMATIC, 1.0, 0.05)
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
    resumed = with_commands(paused, read_with_valve(text, PNEUMATIC, VALVE_START)[0])
    assert resumed.line[at : at + 2].tolist() == [-1, -1]
    np.testing.assert_array_equal(np.delete(resumed.line, [at, at + 1]), found.line)


def test_a_motion_of_another_file_is_refused() -> None:
    text = "\n".join(LINE).encode()
    found = dry_run(text, PNEUMATIC, VALVE_START).executed
    with pytest.raises(DepositError, match="aren't of the same print"):
        pneumatic_deposit(found, text.replace(b"X110", b"X130"), PNEUMATIC, 1.0, 0.05)
    with pytest.raises(DepositError, match="nothing moved"):
        nothing = dry_run(b"G90", PNEUMATIC, VALVE_START).executed
        pneumatic_deposit(nothing, text, PNEUMATIC, 1.0, 0.05)


# The same part by air and by plunger


AIR, PLUNGER = load(Printer, "pneumatic_marlin"), load(Printer, "generic_marlin")
SYRINGE = load(Syringe, "hamilton_1ml")
PLACE, ABOVE = (60.0, 70.0, 20.0), (60.0, 70.0, 60.0)
VOXEL = 0.05


@cache
def fresh_way():
    return fresh_toolpath(drilled_layer(), FreshOptions(joint_mm=0))  # as for a pneumatic head


@cache
def drilled_layer():
    return as_solid(block(4, 3, 0.3) - upright(2, 1.5, 1))


def by_plunger(toolpath: Toolpath) -> Deposit:
    data = write_gcode(toolpath, PLUNGER, SYRINGE, PLACE, GcodeOptions(start_mm=ABOVE)).data
    run = dry_run(data, PLUNGER, ABOVE)
    area = math.pi / 4 * SYRINGE.inner_mm**2
    return deposit(run.executed, area, VOXEL, plunger_step_mm=1 / PLUNGER.steps_per_mm.e)


def by_air(toolpath: Toolpath, flow: float) -> Deposit:
    options = GcodeOptions(start_mm=ABOVE, flow_ul_s=flow)
    data = write_gcode(toolpath, AIR, SYRINGE, PLACE, options).data
    return pneumatic_deposit(dry_run(data, AIR, ABOVE).executed, data, AIR, flow, VOXEL)


def filled(ink: Deposit, at: np.ndarray) -> np.ndarray:
    """Share of ink at points (n, 3); 0 outside the grid."""
    index = np.rint((at - ink.origin_mm) / VOXEL).astype(int)[:, ::-1]
    inside = ((index >= 0) & (index < ink.volume.shape)).all(axis=1)
    found = np.zeros(len(at))
    found[inside] = ink.volume[tuple(index[inside].T)] / 255
    return found


def grid(low: tuple[float, ...], high: tuple[float, ...]) -> np.ndarray:
    axes = [np.arange(a, b, VOXEL) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def test_a_fresh_lumen_stays_open_as_by_plunger() -> None:
    air, plunger = by_air(fresh_way(), 0.02), by_plunger(fresh_way())
    joined = by_plunger(fresh_toolpath(drilled_layer(), FreshOptions()))
    assert air.written_ul == pytest.approx(fresh_way().written_ul, rel=0.02)
    assert air.volume_mm3 == pytest.approx(plunger.volume_mm3, rel=0.02)
    at = grid((60.2, 70.2, 20.06), (63.8, 72.8, 20.25))
    away = np.hypot(at[:, 0] - 62, at[:, 1] - 71.5)
    assert filled(plunger, at[away < 0.42]).max() == 0
    for ink in (air, joined):
        assert filled(ink, at[away < 0.42]).max() == 0
        assert filled(ink, at[away > 0.58]).mean() > 0.97


def test_embedded_vessels_are_as_thick_as_by_plunger() -> None:
    toolpath = embedded_toolpath(random_tree(20, 8, 3, 0.15), EmbeddedOptions())
    air, plunger = by_air(toolpath, 0.3), by_plunger(toolpath)
    assert air.written_ul == pytest.approx(plunger.written_ul, rel=0.03)
    assert air.volume_mm3 == pytest.approx(plunger.volume_mm3, rel=0.04)
