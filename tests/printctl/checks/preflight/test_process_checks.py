"""Checks of time against cell lifetime, ink against syringe, motor steps against moves."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from pydantic import ValidationError

from firmware_profiles import Ink, Needle, Printer, Syringe, load
from printctl.checks.preflight import (
    PrintTime,
    budget_of,
    ink_use,
    step_checks,
    viability_checks,
    viability_facts,
)
from printctl.recipe.making import CarePart
from sim.gcode.dry_run.run import DryRun, dry_run

PRINTER = load(Printer, "generic_marlin")
SYRINGE = load(Syringe, "hamilton_1ml")
INK = load(Ink, "collagen_fresh")
AREA = math.pi / 4 * SYRINGE.inner_mm**2
SAID = {"viability_min": 30.0, "viability_source": "live/dead counts of lot 7"}


def run_of(*lines: str, printer: Printer = PRINTER) -> DryRun:
    return dry_run("\n".join(["M302 P1", "G0 X10 Y10 Z5 F6000", *lines]).encode(), printer)


def ink(**more: object) -> Ink:
    return Ink.model_validate(INK.model_dump() | SAID | more)


def test_a_budget_wants_its_source() -> None:
    with pytest.raises(ValidationError, match="viability_source"):
        ink(viability_source=None)
    with pytest.raises(ValidationError, match="viability_source"):
        CarePart(viability_min=20)


def test_no_shipped_ink_claims_to_know_how_long_its_cells_have() -> None:
    assert budget_of(INK) is None
    assert viability_checks(PrintTime(1e6), None) == []
    assert "not known" in viability_facts(PrintTime(60.0), None)["time_the_cells_have"]


@pytest.mark.parametrize(("minutes", "passed"), [(29.9, True), (30.0, True), (30.1, False)])
def test_print_time_is_held_against_the_budget(minutes: float, passed: bool) -> None:
    (check,) = viability_checks(PrintTime(60 * minutes), budget_of(ink()))
    assert check.passed == passed
    assert not check.refuses
    assert "live/dead counts of lot 7" in check.place


def test_a_measured_ink_or_the_recipe_itself_refuses() -> None:
    sure = ink(calibrated=True, starting_values=())
    (check,) = viability_checks(PrintTime(3600.0), budget_of(sure))
    assert check.refuses
    (check,) = viability_checks(PrintTime(3600.0), budget_of(INK, 45.0, "our protocol"))
    assert check.refuses
    assert check.limit == 45


def test_changes_of_syringe_count_with_their_time_or_are_named() -> None:
    budget = budget_of(ink())
    (check,) = viability_checks(PrintTime(1200.0, 2, 6.0), budget)
    assert check.value == pytest.approx(32)
    assert not check.passed
    known, unknown = viability_checks(PrintTime(1200.0, 2), budget)
    assert known.passed
    assert not unknown.passed
    assert "2 changes" in unknown.remedy
    assert viability_facts(PrintTime(1200.0, 2), budget)["changes_timed"] is False


def test_ink_is_what_is_pushed_and_what_each_filling_leaves_behind() -> None:
    run = run_of("G1 X20 E10 F60", "G1 E9 F60", "G1 X30 E30 F60")
    use = ink_use(run, PRINTER, SYRINGE)
    assert use.pushed_ul == pytest.approx(30 * AREA)
    assert use.dead_ul == 20
    assert use.fillings == 1
    assert use.needed_ul == pytest.approx(30 * AREA + 20)
    needle = load(Needle, "30g")
    assert ink_use(run, PRINTER, SYRINGE, needle).dead_ul == pytest.approx(
        20 + math.pi / 4 * needle.inner_mm**2 * needle.length_mm
    )


def test_more_than_a_syringe_takes_more_fillings() -> None:
    run = run_of("G1 X20 E130 F60")
    use = ink_use(run, PRINTER, SYRINGE)
    # 2170 µL, 980 of each filling.
    assert use.fillings == 3
    assert use.needed_ul == pytest.approx(130 * AREA + 60)
    assert use.loaded_ul == pytest.approx(3000)
    assert ink_use(run, PRINTER, SYRINGE, reloads=4).fillings == 5


def names(run: DryRun, printer: Printer = PRINTER, syringe: Syringe = SYRINGE) -> list[str]:
    checks = step_checks(run, printer, syringe)
    assert not any(check.refuses for check in checks)
    return [check.check for check in checks if not check.passed]


def line(length: float, width: float = 0.15, height: float = 0.06) -> float:
    """Plunger travel of a line, mm."""
    return length * width * height / AREA


def test_long_lines_with_many_digits_are_fine() -> None:
    assert names(run_of(f"G1 X20 E{line(10):.5f} F600")) == []


def test_a_step_of_the_plunger_longer_than_a_move_is_told() -> None:
    """One step is 2.6 nL: 0.29 mm of a line of 150 by 60 µm."""
    run = run_of(f"G1 X20 E{line(10):.6f} F600", f"G1 X20.2 E{line(10.2):.6f}")
    (name,) = names(run)
    assert name.startswith("line that one step of the plunger makes")
    check = next(c for c in step_checks(run, PRINTER, SYRINGE) if not c.passed)
    assert check.value == pytest.approx(1 / 6400 * AREA / (0.15 * 0.06), rel=1e-4)
    assert check.limit == pytest.approx(0.2, abs=1e-9)
    assert check.place == "line 4"
    assert "1 of 2 moves" in check.remedy


def test_an_axis_step_longer_than_a_move_is_told() -> None:
    coarse = PRINTER.model_copy(
        update={"steps_per_mm": PRINTER.steps_per_mm.model_copy(update={"x": 4.0, "e": 1e6})}
    )
    run = run_of(f"G1 X20 E{line(10):.6f} F600", f"G1 X20.2 E{line(10.2):.6f}", printer=coarse)
    assert names(run, coarse) == ["motor step of an axis, against the shortest written move"]


def test_digits_coarser_than_a_line_are_told() -> None:
    fine = PRINTER.model_copy(
        update={"steps_per_mm": PRINTER.steps_per_mm.model_copy(update={"e": 1e6})}
    )
    run = run_of("G1 X30 E0.01 F600", "G0 X40 F600", "G1 X60 E0.02", printer=fine)
    assert names(run, fine) == []
    short = run_of("G1 X30 E0.1 F600", "G0 X40 F600", "G1 X60 E0.105", printer=fine)
    assert names(short, fine) == []  # the file does give three digits here
    wide = load(Syringe, "bd_10ml")
    small = run_of("G1 X30 E1.2345 F600", "G0 X40 F600", "G1 X40.5 E1.2346")
    assert "one step of the plunger, against the least line's dose" in names(small, PRINTER, wide)


def test_a_valve_has_no_plunger_steps() -> None:
    air = load(Printer, "pneumatic_marlin")
    head = air.pneumatic
    assert head is not None
    run = run_of(head.opens, "G1 X10.5 F600", head.closes, printer=air)
    assert [check.check for check in step_checks(run, air, SYRINGE)] == [
        "motor step of an axis, against the shortest written move"
    ]
    use = ink_use(run, air, SYRINGE, flow_ul_s=2.0)
    assert use.pushed_ul > 0
    assert replace(use, fillings=2).needed_ul == pytest.approx(use.pushed_ul + 2 * use.dead_ul)
