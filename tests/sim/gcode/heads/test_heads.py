"""Several heads in reader, simulation and simulated firmwares."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_profiles import Head, Offset, Printer, load
from sim.devices.families.klipper.printer import KlipperPrinter
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.devices.families.reprapfirmware.printer import DuetPrinter
from sim.gcode.deposit.lay import deposit
from sim.gcode.dry_run.run import dry_run
from sim.gcode.program.gcode import read_gcode
from sim.gcode.reading.file import read_file

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
    return {finding.code for finding in dry_run(gcode, printer, (0, 0, 40)).findings}


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


def test_marlin_s_own_offset_shifts_the_frame_without_a_move_where_it_isn_t_homed():
    printer = MarlinPrinter(TWO, (10, 0, 40))
    sent(printer, b"M302 P1\nM218 T1 X40 Y0 Z0\nT1 S1\n")
    assert b"X:50.00" in sent(printer, b"M114\n")
    sent(printer, b"G1 X50 Y1 F600\n")
    assert printer.executed().end[-1].tolist() == [10.0, 1.0, 40.0]


def test_marlin_moves_a_homed_carriage_by_its_own_offset():
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
    plain, named = file.in_g_code, file.named
    assert plain == b"T1\nT0"
    assert named[0].name == "ACTIVATE_EXTRUDER"
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
    with pytest.raises(ValueError, match="same select"):
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
