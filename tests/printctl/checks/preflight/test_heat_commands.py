"""Heater commands in a job: of another head, without a target, beyond the limit."""

from __future__ import annotations

import pytest

from firmware_profiles import Bath, Ink, Printer, load
from printctl.checks.preflight import gcode_checks, temperature_checks
from sim.gcode.dry_run.run import dry_run

MARLIN = load(Printer, "generic_marlin")
PRINTERS = {
    "marlin": MARLIN,
    "prusa": MARLIN.model_copy(update={"firmware": "prusa"}),
    "reprapfirmware": load(Printer, "ender5_duet3_replistruder5"),
    "klipper": load(Printer, "klipper_bioprinter"),
}
INK, BATH = load(Ink, "collagen_fresh"), load(Bath, "gelatin_support")
WARM = (INK.temperature_c.low + INK.temperature_c.high) / 2
CODES = ("M104", "M109", "M140", "M190", "M141", "M191")
ODD = (
    "", f"T9 S{WARM:g}", f"S{WARM:g} T1", f"T0.5 S{WARM:g}", f"T-1 S{WARM:g}", "T9", "S", "S999",
    "R999", "S-5", f"S{WARM:g} R999", f"P9 S{WARM:g}", f"H9 S{WARM:g}",
)  # fmt: skip
CODED = [f"{code} {words}".strip() for code in CODES for words in ODD]
OTHERS = [
    "G10 P0 S999", "G10 S999 R999", f"G10 P9 S{WARM:g}", "M568 P0 S999", f"M568 P9 S{WARM:g}",
    "M303 E0 S999", "M116 P9", "M143 S999", "M144", "M145 S0 H999 B999",
]  # fmt: skip
NAMED = [
    *(
        f"SET_HEATER_TEMPERATURE {words}"
        for words in (
            "HEATER=extruder", "HEATER=extruder TARGET=999", "HEATER=extruder TARGET=-5",
            "HEATER=extruder TARGET=nan", "HEATER=extruder TARGET=inf",
            f"HEATER=extruder9 TARGET={WARM:g}", f"HEATER=extruder1 TARGET={WARM:g}",
            f"HEATER=chamber TARGET={WARM:g}", f"SENSOR=extruder TARGET={WARM:g}",
            f"TARGET={WARM:g}", f"HEATER=extruder MINIMUM={WARM:g}",
        )
    ),
    *(
        f"TEMPERATURE_WAIT {words}"
        for words in (
            "SENSOR=extruder", "SENSOR=extruder MINIMUM=999", "SENSOR=extruder MAXIMUM=-50",
            "SENSOR=heater_bed MINIMUM=999", "SENSOR=extruder MINIMUM=inf",
            "SENSOR=extruder MAXIMUM=inf", "SENSOR=extruder MINIMUM=nan",
            f"SENSOR=extruder MINIMUM={WARM:g} MAXIMUM={WARM - 1:g}",
            f"SENSOR=extruder9 MINIMUM={WARM:g}", f"HEATER=extruder MINIMUM={WARM:g}",
            f"MINIMUM={WARM:g}",
        )
    ),
]  # fmt: skip
FINE = {
    "klipper": [
        f"SET_HEATER_TEMPERATURE HEATER=extruder TARGET={WARM:g}",
        "SET_HEATER_TEMPERATURE HEATER=heater_bed TARGET=0",
        "TEMPERATURE_WAIT SENSOR=extruder MAXIMUM=30",
        f"M104 S{WARM:g}\nTEMPERATURE_WAIT SENSOR=extruder MINIMUM={WARM:g} MAXIMUM=30",
    ]
}


def failed_rows(family: str, line: str):
    printer = PRINTERS[family]
    job = f"G21\nG90\nM82\nG92 E0\n{line}\nG1 X101 F300\n".encode()
    run = dry_run(job, printer, (100, 100, 10))
    rows = [*gcode_checks(run, printer), *temperature_checks(run, INK, BATH)]
    return [row for row in rows if row.refuses and "switch-off" not in row.check]


@pytest.mark.parametrize("line", CODED + OTHERS)
@pytest.mark.parametrize("family", PRINTERS)
def test_odd_heat_is_a_failed_row_that_names_its_line(family, line):
    rows = failed_rows(family, line)
    assert rows, line
    assert any("line 5" in f"{row.place} {row.remedy}" for row in rows)


@pytest.mark.parametrize("line", NAMED)
def test_odd_heat_by_name_is_a_failed_row_that_names_its_line(line):
    rows = failed_rows("klipper", line)
    assert rows, line
    assert any("line 5" in f"{row.place} {row.remedy}" for row in rows)


@pytest.mark.parametrize("family", PRINTERS)
def test_heat_that_ink_and_machine_bear_passes(family):
    fine = [f"M104 S{WARM:g}", f"M104 T0 S{WARM:g}", "M104 S0", "M140 S0", f"M140 S{WARM:g}"]
    for line in (*fine, *FINE.get(family, ())):
        assert failed_rows(family, line) == [], line
