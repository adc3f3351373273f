"""Digital outputs set by a controller's program file: checks."""

from __future__ import annotations

import pytest

from firmware_profiles import FileController, Plunger, Printer, load
from printctl.checks.preflight.gcode import gcode_checks
from printctl.checks.set_up import Check
from sim.gcode.dry_run.run import dry_run

A3200 = load(Printer, "aerotech_pneumatic")
NEWER = A3200.model_copy(
    update={
        "file_controller": FileController(controller="automation1", plunger_axis="A"),
        "dispenser": Plunger(),
        "plunger_travel_mm": 60.0,
    }
)
FILE = "$DO[0].X=0\nG71\nG76\nG90\nVELOCITY ON\nG92 X60 Y70 Z30\n{}\nG1 X61 F5\n"


def outputs(line: str, printer: Printer) -> Check:
    run = dry_run(FILE.format(line).encode(), printer, (60.0, 70.0, 30.0))
    (found,) = [one for one in gcode_checks(run, printer) if one.check.startswith("outputs set")]
    return found


@pytest.mark.parametrize("line", ["$DO[0].X=1", "$DO[0].X = 0", "$do[0].x=0", ""])
def test_the_profile_s_valve_may_be_switched(line):
    assert outputs(line, A3200).passed


@pytest.mark.parametrize(
    "line",
    ["$DO[1].X=1", "$DO[1].X=0", "$DO[0].Y=1", "$DO[0].X=2", "$DO[0].X=(1)", "$DO = 5"]
    + ["DigitalOutputSet(X, 1, 1)"],
)
def test_any_other_output_is_refused_by_its_line(line):
    """A lamp, a heater or a brake may hang there."""
    found = outputs(line, A3200)
    assert (found.refuses, found.place) == (True, "line 7")
    assert "take it out" in found.remedy
    assert "$DO[0].X=1" in found.remedy


def test_a_plunger_s_controller_has_no_output_to_switch():
    assert outputs("G90", NEWER).place == "line 1"
