"""Lines of a G-code file against the needle's bore."""

from __future__ import annotations

import math

import pytest

from firmware_profiles import Ink, Needle, Printer, Syringe, load
from printctl.checks.preflight.bore import line_checks
from printctl.checks.set_up import Check, HeadLoading
from sim.gcode.dry_run.run import dry_run

PRINTER = load(Printer, "generic_marlin")
SYRINGE = load(Syringe, "hamilton_1ml")
INK = load(Ink, "collagen_fresh")


def check_of(area_mm2: float, needle: str, rise_mm: float, layer_mm: float = 0.06) -> Check:
    """Two strokes of 20 mm with so much ink a mm, on two levels or each rising."""
    per_mm = area_mm2 / (math.pi / 4 * SYRINGE.inner_mm**2 * INK.flow_factor)
    lines, e = ["G21", "G90", "M82", "M302 P1", "G1 X50 Y50 Z10 F1200"], 0.0
    for k in range(2):
        z, e = 10 + k * layer_mm, e + 20 * per_mm
        lines += [f"G1 X50 Z{z:g} F1200", f"G1 X70 Z{z + rise_mm:g} E{e:.6f} F300"]
    run = dry_run("\n".join(lines).encode(), PRINTER, (50, 50, 10))
    (check,) = line_checks(run, PRINTER, HeadLoading(SYRINGE, INK, load(Needle, needle)))
    return check


@pytest.mark.parametrize(
    ("needle", "passed"), [("fresh_150um", True), ("30g", True), ("27g", False), ("18g", False)]
)
def test_lines_of_layers_are_held_against_the_bore(needle: str, passed: bool) -> None:
    area = float(INK.bead_section.area(0.15, 0.06))
    check = check_of(area, needle, 0.0)
    assert check.value == pytest.approx(0.15, rel=0.02)
    assert check.passed == passed
    assert "line 7" in check.place


@pytest.mark.parametrize(("filament_mm", "passed"), [(0.128, True), (0.10, False)])
def test_filaments_are_held_against_the_bore(filament_mm: float, passed: bool) -> None:
    check = check_of(math.pi / 4 * filament_mm**2, "30g", 5.0)
    assert check.value == pytest.approx(filament_mm, rel=0.02)
    assert check.passed == passed
