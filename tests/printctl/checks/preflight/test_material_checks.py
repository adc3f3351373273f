"""Checks of ink, bath, dish and force: each refusal names place, value, limit and remedy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

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
    SetUp,
    chemistry_check,
    dish_checks,
    file_checks,
    force_checks,
    hardest_push,
    held_check,
)
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
