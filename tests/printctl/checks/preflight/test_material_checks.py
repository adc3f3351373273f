"""Checks of ink, bath, dish and force: each refusal names place, value, limit and remedy."""

from __future__ import annotations

import math
from dataclasses import replace
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
    Plate,
    Printer,
    Syringe,
    load,
    supported_diameter_mm,
    wall_stress_pa,
)
from gcode.dry_run.run import DryRun, dry_run
from printctl.checks.preflight import (
    Check,
    PlacedDish,
    PrintTime,
    SetUp,
    Wells,
    budget_of,
    check_each_head,
    chemistry_check,
    dish_checks,
    file_checks,
    force_checks,
    gcode_checks,
    hardest_push,
    head_checks,
    held_check,
    ink_use,
    step_checks,
    syringe_checks,
    viability_checks,
    viability_facts,
    well_checks,
)
from printctl.checks.preflight.bore import line_checks
from printctl.checks.preflight.dish import hub_gap, wall_gap
from printctl.checks.set_up import HeadLoading, ProfileNames, hub_gap_of, set_up, wall_gap_of
from printctl.recipe.sections.making import CarePart
from tests.printctl.machine.link.two_heads import DATA, QUICK, START, SYRINGES

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
    assert "friction unknown" in checks[1].check
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
    check = named(dish_checks(run_of(*lines), standing(), NEEDLE), "needle to dish wall")
    assert check.value == pytest.approx(gap)
    assert check.passed == (gap >= 1)
    assert check.place == f"line {line}"


@pytest.mark.parametrize(("centre", "aside_mm"), [(None, 0.0), ("90,84", 5.0)])
def test_a_dish_stands_under_the_tip_where_its_centre_isnt_given(
    centre: str | None, aside_mm: float
) -> None:
    tip = (93.0, 80.0, 5.0)
    names = ProfileNames("30g", None, "petri_60mm", centre, None)
    mounted = set_up(PRINTER, "hamilton_1ml", "collagen_fresh", tip, names)
    run = run_of("G1 X93 F600", start=tip)
    check = named(dish_checks(run, mounted.standing, NEEDLE), "needle to dish wall")
    assert check.value == pytest.approx(26.0 - aside_mm - 0.155)


def test_depth_of_the_bath_covers_the_part_and_spares_the_hub() -> None:
    run = run_of("G92 E0", "G1 Z2 F60", "G1 X105 E0.01 F600", "G1 Z11 F60", "G1 X106 E0.02 F600")
    checks = dish_checks(run, standing(), NEEDLE)
    top = named(checks, "highest extrusion")
    assert (top.value, top.limit, top.place) == (11, 10, "line 6")
    assert top.refuses
    assert named(checks, "immersion depth").passed
    deep = dish_checks(run, standing(bath_mm=15.0), NEEDLE)
    assert named(deep, "bath depth").refuses  # the wall is 12 mm high
    assert named(deep, "immersion depth").refuses  # 13 mm below the surface, 12.7 mm long


@pytest.mark.parametrize(
    ("bath_mm", "dishes"),
    [
        (12.5, "use a higher dish: petri_100mm (14 mm), box_80mm (60 mm)"),
        (70.0, "no shipped dish holds this bath"),
    ],
)
def test_a_bath_too_deep_names_the_shipped_dishes_that_hold_it(bath_mm: float, dishes: str) -> None:
    run = run_of("G92 E0", "G1 Z2 F60", "G1 X105 E0.01 F600")
    check = named(dish_checks(run, standing(bath_mm=bath_mm), NEEDLE), "bath depth")
    assert check.refuses
    assert dishes in check.remedy


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
    check, *_ = line_checks(run, PRINTER, HeadLoading(SYRINGE, INK, load(Needle, needle)))
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
    assert "2 syringe changes" in unknown.remedy
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


def test_a_plunger_step_is_compared_with_the_bead_not_with_its_moves() -> None:
    """One step is 2.6 nL: 0.29 mm of a bead of 150 by 60 µm, in however many moves."""
    many = (f"G1 X{x / 10:.1f} E{line(x / 10 - 10):.6f} F600" for x in range(101, 201))
    run = run_of_process_checks("G0 X10", *many)
    assert names(run) == []
    check = next(c for c in step_checks(run, PRINTER, SYRINGE) if c.check.startswith("bead length"))
    assert check.value == pytest.approx(1 / 6400 * AREA / (0.15 * 0.06), rel=1e-3)
    wide = load(Syringe, "hamilton_10ml")
    run = run_of_process_checks(f"G1 X20 E{10 * 0.15 * 0.06 / wide.area_mm2:.6f} F600")
    assert "bead length per plunger step" in names(run, syringe=wide)


def test_beads_of_less_than_a_step_are_told_by_their_share_of_the_ink() -> None:
    dots = (f"G0 Y{y}\nG1 X{20 + y % 2 / 10:.1f} E{line(10 + y / 10):.6f}" for y in range(1, 6))
    run = run_of_process_checks(f"G1 X20 E{line(10):.6f} F600", *dots)
    (name,) = names(run)
    assert name == "ink in beads of less than one plunger step"


# --- idle needles against bath, ink and wall; timely raising and lowering of heads
PETRI = load(Dish, "petri_60mm")
STANDING = PlacedDish(PETRI, (62.0, 72.0), 0.0, 10.0)


def found(data=DATA, printer=QUICK, standing=STANDING):
    run = dry_run(data, printer, START)
    checks = head_checks(run, printer, standing, (NEEDLE, NEEDLE))
    return {check.check: check for check in checks}


def refused(**given):
    return sorted(name for name, check in found(**given).items() if check.refuses)


def head_with(number, **changes):
    heads = list(QUICK.heads)
    heads[number] = heads[number].model_copy(update=changes)
    return QUICK.model_copy(update={"heads": tuple(heads)})


def test_a_job_of_the_writer_passes():
    assert refused() == []
    run = dry_run(DATA, QUICK, START)
    assert not [check.check for check in gcode_checks(run, QUICK) if check.refuses]


def test_a_needle_that_is_raised_too_little_drags_through_gel():
    checks = found(printer=head_with(0, raised_mm=3.0))
    drags = checks["lowest idle tip vs. the bath surface"]
    assert drags.refuses
    assert drags.value == pytest.approx(6.0 + 3.0)
    assert drags.limit == 10.0
    assert "left" in drags.remedy


def test_without_a_known_bath_what_is_written_is_the_limit():
    fixed = head_with(1, raised_mm=0.0, raises=None, lowers=None)
    checks = found(printer=fixed, standing=None)
    assert checks["lowest idle tip vs. the print"].refuses is False
    deeper = fixed.heads[1].offset_mm.model_copy(update={"z": -1.0})
    lower = QUICK.model_copy(
        update={"heads": (fixed.heads[0], fixed.heads[1].model_copy(update={"offset_mm": deeper}))}
    )
    checks = found(printer=lower, standing=None)
    assert checks["lowest idle tip vs. the print"].refuses


def test_a_needle_that_swings_over_the_wall_below_its_top_is_found():
    wall = "idle needle to dish wall"
    shallow = replace(STANDING, bath_mm=9.0)
    assert refused(printer=head_with(0, raised_mm=5.5), standing=shallow) == [wall]
    assert refused(printer=head_with(0, raised_mm=6.5), standing=shallow) == []


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [
        (b"M280 P1 S90\n", b"M105\n", "moves before every head was raised or lowered"),
        (b"M280 P1 S10\n", b"M105\n", "plunger moves with the head raised"),
        (
            b"M400\nM280 P0 S90\nG4 P50\n",
            b"M280 P0 S90\nM105\n",
            "heads raised or lowered while moving",
        ),
    ],
)
def test_what_is_left_out_is_found(old, new, name):
    assert old in DATA
    assert name in refused(data=DATA.replace(old, new, 1))


def test_a_head_lowered_into_the_print_is_found():
    low = DATA.replace(b"G0 Z20", b"G0 Z5.5")
    assert low != DATA
    assert "lowest tip at head lowering vs. top of the print" in refused(data=low)


def test_a_swing_that_isn_t_waited_for_is_told():
    hasty = found(data=DATA.replace(b"G4 P50\n", b""))
    check = hasty["heads raised or lowered without their delay"]
    assert not check.passed
    assert check.weight == "warns"


def test_each_head_is_held_against_its_own_syringe():
    run = dry_run(DATA, QUICK, START)
    tiny = SYRINGES[1].model_copy(update={"volume_ul": 2.0, "dead_volume_ul": 0.0})
    loads = (SYRINGES[0], tiny)
    checks = check_each_head(run, QUICK, lambda k, view, one: syringe_checks(view, one, loads[k]))
    failed = [check.check for check in checks if check.refuses and "profile" not in check.check]
    assert failed == ["head 1 (right): ink incl. 0 µL dead volume"]


def test_findings_of_heads_refuse_by_their_names():
    data = DATA.replace(b"M218 T1 X0 Y0 Z0", b"M218 T1 X40 Y0 Z0")
    run = dry_run(data, QUICK, START)
    failed = [check for check in gcode_checks(run, QUICK) if check.refuses]
    assert "head offsets that would be applied twice" in [check.check for check in failed]


# --- checks of plate wells, on handwritten jobs
PLATE = load(Plate, "corning_24")
LONG = load(Needle, "30g_50mm")
SHORT = load(Needle, "30g")
# A1 at (50, 100) and A2 at (69.3, 100); rims at 17.4 mm, ways from 22.27 mm.
CENTRES = [(50 + 19.3 * column, 100 - 19.3 * row) for row in range(4) for column in range(6)]
WELLS = Wells(PLATE.wells, np.array(CENTRES), PLATE.dish(), 0.0, 8.0, 22.27, {"A1": 5.0, "A2": 5.0})
INTO_A1 = ["G0 Z2 F300", "G1 X52 E0.01 F300", "G0 Z23 F300"]
TO_A2 = ["G0 X69.3 F1200", "G0 Z2 F300", "G1 X71 E0.02 F300", "G0 Z23 F300"]


def checks(lines: list[str], wells: Wells = WELLS, needle: Needle = LONG) -> list[Check]:
    job = "\n".join(["G21", "G90", "M82", "M302 P1", "G92 E0", *lines, ""])
    return well_checks(dry_run(job.encode(), PRINTER, (50.0, 100.0, 23.0)), wells, needle)


def failed(lines: list[str], wells: Wells = WELLS, needle: Needle = LONG) -> dict[str, str]:
    return {one.check: one.place for one in checks(lines, wells, needle) if not one.passed}


def value(lines: list[str], name: str, wells: Wells = WELLS, needle: Needle = LONG) -> float:
    (found,) = [one for one in checks(lines, wells, needle) if one.check.startswith(name)]
    return found.value


def test_a_job_in_order_passes_all() -> None:
    assert failed([*INTO_A1, *TO_A2]) == {}


def test_a_way_below_the_rims_is_refused_with_both_wells() -> None:
    low = [INTO_A1[0], INTO_A1[1], "G0 Z22 F300", *TO_A2]
    assert failed(low) == {
        "travel between wells vs. plate rim": "line 9",
        "needle to well wall": "well A2, line 9",
    }
    assert value(low, "travel between wells") == 22


def test_the_wall_is_as_far_as_the_well_is_wide() -> None:
    lines = ["G0 Z2 F300", "G1 X55 E0.01 F300", "G0 Z23 F300"]
    gap = 15.62 / 2 - 5 - 0.31 / 2
    assert value(lines, "needle to well wall") == pytest.approx(gap)
    assert failed(["G0 Z2 F300", "G1 X56.9 E0.01 F300"]) == {
        "needle to well wall": "well A1, line 7"
    }


def test_a_hub_goes_into_a_well_only_where_it_fits() -> None:
    """Half an inch above 2 mm is 14.7 mm, below the rim at 17.4; 12 mm are taken for the hub."""
    assert failed(INTO_A1, needle=SHORT) == {"needle hub to well wall": "well A1, line 7"}
    slim = SHORT.model_copy(update={"hub_outer_mm": 6.0})
    gap = 15.62 / 2 - 2 - 6 / 2
    assert value(INTO_A1, "needle hub", needle=slim) == pytest.approx(gap)
    above = ["G0 Z4.8 F300", "G1 X52 E0.01 F300", "G0 Z23 F300"]  # 17.5 mm: over the rim
    assert failed(above, needle=SHORT) == {}


def test_the_bath_rises_by_ink_and_needle_and_must_not_run_over() -> None:
    area = math.pi / 4 * 15.62**2
    rise = (5.0 + math.pi / 4 * 0.31**2 * (8 - 2)) / area
    assert value(INTO_A1, "well bath depth") == pytest.approx(8 + rise)
    full = replace(WELLS, bath_mm=17.4 - rise / 2)
    assert failed(INTO_A1, full) == {
        "well bath depth with ink and needle vs. rim": ("well A1, plate.bath_depth_mm")
    }


def test_writing_above_the_bath_and_a_hub_in_it_are_refused() -> None:
    assert failed(INTO_A1, replace(WELLS, bath_mm=1.5)) == {
        "highest extrusion in a well vs. bath surface": "well A1, line 7"
    }
    stub = LONG.model_copy(update={"length_mm": 5.0, "hub_outer_mm": 1.0})
    assert failed(INTO_A1, needle=stub) == {
        "immersion depth in a well vs. needle length": "well A1, line 6"
    }


def test_a_well_that_holds_no_part_isn_t_entered() -> None:
    only = replace(WELLS, ink_ul={"A1": 5.0})
    assert failed([*INTO_A1, *TO_A2], only) == {
        "wells entered without printing": "well A2, line 10"
    }
