"""Tip positions declared in a job: once, before the first move."""

from __future__ import annotations

import pytest

from firmware_profiles import Printer, load
from printctl.checks.preflight import gcode_checks
from sim.gcode.dry_run.run import dry_run

MARLIN = load(Printer, "generic_marlin")
KLIPPER = load(Printer, "klipper_bioprinter")
DUET = load(Printer, "ender5_duet3_replistruder5")
START = (100, 100, 20)


def told_anew(printer, *lines, start=START):
    job = "\n".join(["G21", "G90", "M82", *lines, "M400", ""]).encode()
    rows = gcode_checks(dry_run(job, printer, start), printer)
    return [row for row in rows if row.check.startswith("place of")]


PLACED = "G92 X100 Y100 Z20 E0"
NAMED = "SET_KINEMATIC_POSITION X=100 Y=100 Z=20"


@pytest.mark.parametrize(
    ("printer", "lines", "told"),
    [
        (MARLIN, [PLACED, "G92 Z100", "G1 Z101 F200", "G92 Z20"], ("Z", 100, 20)),
        (MARLIN, [PLACED, "G1 Z21 F200", "G92 Z20"], ("Z", 20, 21)),
        (MARLIN, [PLACED, "G1 X101 F200", "G92 X0"], ("X", 0, 101)),
        (MARLIN, ["G1 X101 F200", "G92 X0"], ("X", 0, 101)),
        (KLIPPER, [NAMED, "G1 Z21 F200", "SET_KINEMATIC_POSITION Z=100"], ("Z", 100, 21)),
        (KLIPPER, [NAMED, "G92 Z5", "G1 Z6 F200"], ("Z", 5, 20)),
        (KLIPPER, ["G92 X30", "SET_KINEMATIC_POSITION X=30", "G1 X32 F200"], ("X", 30, 100)),
        (DUET, [PLACED, "G92 Z0", "G1 Z1 F200"], ("Z", 0, 20)),
    ],
)
def test_another_place_told_later_is_a_failed_row(printer, lines, told):
    (row,) = told_anew(printer, *lines)
    axis, value, stands = told
    assert row.refuses
    assert (row.check, row.value, row.limit) == (f"place of {axis} told anew", value, stands)


@pytest.mark.parametrize(
    ("printer", "lines"),
    [
        (MARLIN, [PLACED, "G1 X101 E1 F200", "G92 E0", "G1 X102 E1"]),
        (MARLIN, [PLACED, "G1 X101 Z22 F200", "G92 X101 Z22"]),
        (KLIPPER, [NAMED, "G92 E0", "G1 X101 F200", "SET_KINEMATIC_POSITION X=101"]),
        (DUET, ["G92 X100", "G92 Y100", "G92 Z20", "G1 X101 F200"]),
    ],
)
def test_the_same_place_and_the_plunger_s_count_pass(printer, lines):
    assert told_anew(printer, *lines) == []
    moved = (0, 0, 0)
    assert told_anew(printer, *lines, start=moved) == []
