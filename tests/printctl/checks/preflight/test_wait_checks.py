"""Temperature waits that no heater can satisfy."""

from __future__ import annotations

import pytest

from firmware_profiles import Printer, load
from printctl.checks.preflight import gcode_checks
from sim.gcode.dry_run.run import dry_run

MARLIN = load(Printer, "generic_marlin")
KLIPPER = load(Printer, "klipper_bioprinter")
DUET = load(Printer, "ender5_duet3_replistruder5")


def waits(printer, *lines):
    job = "\n".join(["G21", "G90", "M82", "G92 E0", *lines, "G1 X101 F300", ""])
    rows = gcode_checks(dry_run(job.encode(), printer, (100, 100, 10)), printer)
    return [row for row in rows if row.check.startswith("wait for a temperature")]


@pytest.mark.parametrize("printer", [MARLIN, DUET], ids=["marlin", "duet"])
@pytest.mark.parametrize("line", ["M109 R5", "M190 R2", "M191 S5", "M191 R25", "M109 R29.9"])
def test_a_wait_for_cold_is_a_failed_row_with_its_line_and_the_room(printer, line):
    (row,) = waits(printer, line)
    assert row.refuses
    assert row.place == "line 5"
    assert (row.value, row.limit) == (float(line[6:]), 30)
    assert "a room of 15 to 30" in row.remedy


@pytest.mark.parametrize(
    "lines",
    [
        ["TEMPERATURE_WAIT SENSOR=extruder MAXIMUM=5"],
        ["M104 S0", "TEMPERATURE_WAIT SENSOR=extruder MINIMUM=9"],
        ["M104 S8", "TEMPERATURE_WAIT SENSOR=extruder MINIMUM=9"],
        ["TEMPERATURE_WAIT SENSOR=heater_bed MINIMUM=35"],
        ["M140 S36", "TEMPERATURE_WAIT SENSOR=heater_bed MAXIMUM=35"],
        ["M109 S5"],
        ["M190 S25"],
    ],
)
def test_a_wait_that_klipper_never_ends_is_a_failed_row(lines):
    (row,) = waits(KLIPPER, *lines)
    assert row.refuses
    assert row.place == f"line {4 + len(lines)}"


@pytest.mark.parametrize(
    ("printer", "lines"),
    [
        (MARLIN, ["M109 S5"]),
        (MARLIN, ["M109 R37"]),
        (MARLIN, ["M190 S37"]),
        (MARLIN, ["M104 S5"]),
        (KLIPPER, ["M190 S37", "TEMPERATURE_WAIT SENSOR=heater_bed MINIMUM=36 MAXIMUM=38"]),
        (KLIPPER, ["SET_HEATER_TEMPERATURE HEATER=extruder TARGET=9",
                   "TEMPERATURE_WAIT SENSOR=extruder MINIMUM=9"]),
        (KLIPPER, ["M109 S0"]),
    ],
)  # fmt: skip
def test_a_wait_that_heaters_end_passes(printer, lines):
    assert waits(printer, *lines) == []
