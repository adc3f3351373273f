"""Checks of ink, bath, dish and force: each refusal names place, value, limit and remedy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from firmware_profiles import (
    Bath,
    Dish,
    Ink,
    Needle,
    Printer,
    Syringe,
    load,
    supported_diameter_mm,
    wall_stress_pa,
)
from printctl.checks.preflight import (
    Check,
    PlacedDish,
    PrintTime,
    SetUp,
    budget_of,
    chemistry_check,
    dish_checks,
    file_checks,
    force_checks,
    hardest_push,
    held_check,
    ink_use,
    step_checks,
    viability_checks,
    viability_facts,
)
from printctl.checks.preflight.bore import line_checks
from printctl.checks.preflight.dish import hub_gap, wall_gap
from printctl.checks.set_up import HeadLoading, hub_gap_of, wall_gap_of
from printctl.recipe.making import CarePart
from sim.gcode.dry_run.run import DryRun, dry_run

PRINTER = load(Printer, "generic_marlin")
SYRINGE = load(Syringe, "hamilton_1ml")
NEEDLE = load(Needle, "30g")
COLLAGEN, ALGINATE, FIBRIN = (
    load(Ink, name) for name in ("collagen_fresh", "alginate_fresh", "fibrinogen_fresh")
)
GELATIN, CALCIUM, THROMBIN = (
    load(Bath, f"gelatin_{name}") for name in ("support", "calcium", "thrombin")
)


def run_of(*lines: str, start: tuple[float, float, float] = (100, 100, 10)) -> DryRun:
    return dry_run("\n".join(["M302 P1", *lines]).encode(), PRINTER, start)


@pytest.mark.parametrize(
    ("ink", "bath", "fits"),
    [
        (COLLAGEN, GELATIN, True),
        (COLLAGEN, CALCIUM, False),
        (ALGINATE, CALCIUM, True),
        (ALGINATE, GELATIN, False),
        (FIBRIN, THROMBIN, True),
        (FIBRIN, CALCIUM, False),
        (load(Ink, "gelatin_sacrificial"), load(Bath, "cell_matrix"), True),
    ],
)
def test_an_ink_prints_only_where_the_bath_sets_it(ink: Ink, bath: Bath, fits: bool) -> None:
    check = chemistry_check(ink, bath)
    assert check.passed == fits
    assert fits or check.refuses
    assert fits or ink.name in check.sentence()


# --- what the bath holds ------------------------------------------------------------------------


def densities(ink: float, bath: float, yield_stress_pa: float) -> tuple[Ink, Bath]:
    return (
        COLLAGEN.model_copy(update={"density_g_cm3": ink}),
        GELATIN.model_copy(update={"density_g_cm3": bath, "yield_stress_pa": yield_stress_pa}),
    )


def test_held_diameter_is_that_of_the_formula() -> None:
    ink, bath = densities(1.10, 1.00, 0.1)
    # 0.1 Pa / (0.07 × 100 kg/m³ × 9.81 m/s²) = 1.456 mm
    assert supported_diameter_mm(bath, ink) == pytest.approx(1.4563, rel=1e-4)
    twice = bath.model_copy(update={"yield_stress_pa": 0.2})
    assert supported_diameter_mm(twice, ink) == pytest.approx(2 * supported_diameter_mm(bath, ink))
    assert supported_diameter_mm(*reversed(densities(1.0, 1.0, 0.1))) == math.inf


@pytest.mark.parametrize(("widest", "passed"), [(1.4, True), (1.5, False)])
def test_a_filament_that_would_sink_is_named(widest: float, passed: bool) -> None:
    check = held_check(widest, *densities(1.10, 1.00, 0.1))
    assert check.passed == passed
    assert not check.refuses  # neither is measured
    measured = [thing.model_copy(update={"calibrated": True}) for thing in densities(1.1, 1.0, 0.1)]
    assert held_check(widest, *measured).refuses == (not passed)


# --- force --------------------------------------------------------------------------------------


def test_newtonian_push_is_poiseuille_s() -> None:
    ink = COLLAGEN.model_copy(update={"viscosity_pa_s": 2.0})
    run = run_of("G92 E0", "G1 X110 E0.1 F600", "G1 X120 E0.15 F600")
    push = hardest_push(run, ink, NEEDLE, SYRINGE)
    flow = 0.1 * math.pi / 4 * 4.61**2  # 0.1 mm of plunger in 1 s
    assert push.flow_ul_s == pytest.approx(flow)
    assert push.line == 3
    resistance = 128 * 2.0 * NEEDLE.length_mm / (math.pi * NEEDLE.inner_mm**4)
    assert push.pressure_pa == pytest.approx(resistance * flow)
    assert push.force_n == pytest.approx(resistance * flow * math.pi / 4 * 4.61**2 * 1e-6)


def test_a_fast_retraction_is_no_push() -> None:
    ink = COLLAGEN.model_copy(update={"viscosity_pa_s": 2.0})
    run = run_of("G92 E0", "G1 X110 E0.1 F600", "G1 E0 F100", "G1 E-1 F120")
    assert hardest_push(run, ink, NEEDLE, SYRINGE).line == 3
    assert hardest_push(run_of("G92 E0", "G1 E-1 F60"), ink, NEEDLE, SYRINGE).force_n == 0


def test_power_law_shear_is_that_of_its_velocity_profile() -> None:
    ink = COLLAGEN.model_copy(update={"viscosity_pa_s": 30.0, "flow_index": 0.4})
    flow, bore, n = 0.3, 0.16, 0.4
    shear = wall_stress_pa(ink, bore, flow)
    # Integrate v(r) for that wall stress and find the flow again.
    radius = bore / 2
    r = np.linspace(0, radius, 20001)
    rate = (shear * r / radius / 30.0) ** (1 / n)
    speed = np.concatenate([np.cumsum((rate[1:] + rate[:-1])[::-1])[::-1], [0]]) * (r[1] / 2)
    found = np.trapezoid(2 * math.pi * r * speed, r)
    assert found == pytest.approx(flow, rel=1e-5)


@pytest.mark.parametrize(("calibrated", "refuses"), [(True, True), (False, False)])
def test_only_a_measured_ink_is_refused_for_its_pressure(calibrated: bool, refuses: bool) -> None:
    measured = {"calibrated": calibrated, "starting_values": ()}
    ink = COLLAGEN.model_copy(update={**measured, "max_shear_stress_pa": 1e3})
    syringe = SYRINGE.model_copy(update={"max_pressure_kpa": 100.0})
    printer = PRINTER.model_copy(update={"max_plunger_force_n": 5.0})
    run = run_of("G92 E0", "G1 X110 E0.1 F600")
    checks = force_checks(run, ink, NEEDLE, syringe, printer)
    assert [check.unit for check in checks] == ["kPa", "N", "Pa"]
    assert "friction not known" in checks[1].check
    assert all(check.place == "line 3" and not check.passed for check in checks)
    assert all(check.refuses == refuses for check in checks)


# --- dish ---------------------------------------------------------------------------------------


def standing(**changes: Any) -> PlacedDish:
    dish = load(Dish, "petri_60mm")
    return PlacedDish(dish, (100.0, 100.0), 0.0, changes.pop("bath_mm", 10.0))


def named(checks: list[Check], name: str) -> Check:
    (found,) = [check for check in checks if check.check.startswith(name)]
    return found


@pytest.mark.parametrize(
    ("lines", "gap", "line"),
    [
        (["G1 Z5 F60", "G1 X120 F600"], 6.0 - 0.155, 3),
        (["G1 Z5 F60", "G1 X118 Y118 F600"], 26 - math.hypot(18, 18) - 0.155, 3),
        (["G1 Z30 F60", "G1 X190 F600"], 26.0 - 0.155, 2),
        (["G1 Z30 F60", "G1 X130 F600", "G1 Z11 F60"], -4.0 - 0.155, 4),
    ],
)
def test_needle_keeps_off_a_round_wall_below_its_top(
    lines: list[str], gap: float, line: int
) -> None:
    check = named(dish_checks(run_of(*lines), standing(), NEEDLE), "needle to the dish's wall")
    assert check.value == pytest.approx(gap)
    assert check.passed == (gap >= 1)
    assert check.place == f"line {line}"


def test_depth_of_the_bath_covers_the_part_and_spares_the_hub() -> None:
    run = run_of("G92 E0", "G1 Z2 F60", "G1 X105 E0.01 F600", "G1 Z11 F60", "G1 X106 E0.02 F600")
    checks = dish_checks(run, standing(), NEEDLE)
    top = named(checks, "highest writing")
    assert (top.value, top.limit, top.place) == (11, 10, "line 6")
    assert top.refuses
    assert named(checks, "deepest tip").passed
    deep = dish_checks(run, standing(bath_mm=15.0), NEEDLE)
    assert named(deep, "depth of the bath").refuses  # the wall is 12 mm high
    assert named(deep, "deepest tip").refuses  # 13 mm below the surface, 12.7 mm long


# --- all of it ----------------------------------------------------------------------------------


@pytest.mark.parametrize("line", ["G29", "G30 X10 Y10", "BED_MESH_CALIBRATE"])
def test_probing_with_the_needle_mounted_is_refused(line: str) -> None:
    klipper = PRINTER.model_copy(
        update={"firmware": "klipper", "extra_commands": ("G29", "G30", "BED_MESH_CALIBRATE")}
    )
    run = dry_run(f"G90\n{line}\n".encode(), klipper, (100, 100, 10))
    check = named(file_checks(run, SetUp(klipper, SYRINGE, COLLAGEN)), "probing with the needle")
    assert check.refuses
    assert check.place == "line 2"


# --- lines of a G-code file against the needle's bore
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


# --- clearance between needle and dish wall, for single and for many moves
NEEDLE_WALL_GAPS = load(Needle, "25g")
coordinate = st.floats(-50, 150)
place = st.tuples(coordinate, coordinate, st.floats(-5, 40))


@given(st.sampled_from(["petri_60mm", "chamber_slide"]), st.lists(st.tuples(place, place)))
def test_one_move_has_the_gap_that_it_has_among_many(name, moves):
    standing = PlacedDish(load(Dish, name), (40.0, 50.0), 3.0)
    tips, rows = np.array(moves).reshape(-1, 2, 3), np.ones(len(moves), np.bool_)
    alone = [wall_gap_of(ends, standing, 0.5) for ends in moves]
    assert alone == pytest.approx(wall_gap(tips, rows, standing, 0.5))
    alone = [hub_gap_of(ends, standing, NEEDLE_WALL_GAPS) for ends in moves]
    assert alone == pytest.approx(hub_gap(tips, rows, standing, NEEDLE_WALL_GAPS))


# --- checks of time against cell lifetime, ink against syringe, motor steps against moves
AREA = math.pi / 4 * SYRINGE.inner_mm**2
SAID = {"viability_min": 30.0, "viability_source": "live/dead counts of lot 7"}


def run_of_process_checks(*lines: str, printer: Printer = PRINTER) -> DryRun:
    return dry_run("\n".join(["M302 P1", "G0 X10 Y10 Z5 F6000", *lines]).encode(), printer)


def ink(**more: object) -> Ink:
    return Ink.model_validate(INK.model_dump() | SAID | more)


def test_a_budget_wants_its_source() -> None:
    with pytest.raises(ValidationError, match="viability_source"):
        ink(viability_source=None)
    with pytest.raises(ValidationError, match="viability_source"):
        CarePart(viability_min=20)


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
    run = run_of_process_checks("G1 X20 E10 F60", "G1 E9 F60", "G1 X30 E30 F60")
    use = ink_use(run, PRINTER, SYRINGE)
    assert use.pushed_ul == pytest.approx(30 * AREA)
    assert use.dead_ul == 20
    assert use.fillings == 1
    assert use.needed_ul == pytest.approx(30 * AREA + 20)
    needle = load(Needle, "30g")
    assert ink_use(run, PRINTER, SYRINGE, needle).dead_ul == pytest.approx(
        20 + math.pi / 4 * needle.inner_mm**2 * needle.length_mm
    )


def names(run: DryRun, printer: Printer = PRINTER, syringe: Syringe = SYRINGE) -> list[str]:
    checks = step_checks(run, printer, syringe)
    assert not any(check.refuses for check in checks)
    return [check.check for check in checks if not check.passed]


def line(length: float, width: float = 0.15, height: float = 0.06) -> float:
    """Plunger travel of a line, mm."""
    return length * width * height / AREA


def test_a_step_of_the_plunger_longer_than_a_move_is_told() -> None:
    """One step is 2.6 nL: 0.29 mm of a line of 150 by 60 µm."""
    run = run_of_process_checks(f"G1 X20 E{line(10):.6f} F600", f"G1 X20.2 E{line(10.2):.6f}")
    (name,) = names(run)
    assert name.startswith("line that one step of the plunger makes")
    check = next(c for c in step_checks(run, PRINTER, SYRINGE) if not c.passed)
    assert check.value == pytest.approx(1 / 6400 * AREA / (0.15 * 0.06), rel=1e-4)
    assert check.limit == pytest.approx(0.2, abs=1e-9)
    assert check.place == "line 4"
    assert "1 of 2 moves" in check.remedy
