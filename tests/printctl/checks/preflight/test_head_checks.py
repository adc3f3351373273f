"""Idle needles against bath, ink and wall; timely raising and lowering of heads."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from firmware_profiles import Dish, Needle, Plate, Printer, load
from printctl.checks.preflight import (
    Check,
    PlacedDish,
    Wells,
    check_each_head,
    gcode_checks,
    head_checks,
    syringe_checks,
    well_checks,
)
from sim.gcode.dry_run.run import dry_run
from tests.printctl.machine.link.two_heads import DATA, QUICK, START, SYRINGES

NEEDLE = load(Needle, "30g")
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
    drags = checks["lowest tip that doesn't write, above the bath's surface"]
    assert drags.refuses
    assert drags.value == pytest.approx(6.0 + 3.0)
    assert drags.limit == 10.0
    assert "left" in drags.remedy


def test_without_a_known_bath_what_is_written_is_the_limit():
    fixed = head_with(1, raised_mm=0.0, raises=None, lowers=None)
    checks = found(printer=fixed, standing=None)
    assert checks["lowest tip that doesn't write, above all that is written"].refuses is False
    deeper = fixed.heads[1].offset_mm.model_copy(update={"z": -1.0})
    lower = QUICK.model_copy(
        update={"heads": (fixed.heads[0], fixed.heads[1].model_copy(update={"offset_mm": deeper}))}
    )
    checks = found(printer=lower, standing=None)
    assert checks["lowest tip that doesn't write, above all that is written"].refuses


def test_a_needle_that_swings_over_the_wall_below_its_top_is_found():
    wall = "needle that doesn't write, to the dish's wall"
    shallow = replace(STANDING, bath_mm=9.0)
    assert refused(printer=head_with(0, raised_mm=5.5), standing=shallow) == [wall]
    assert refused(printer=head_with(0, raised_mm=6.5), standing=shallow) == []


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [
        (b"M280 P1 S90\n", b"M105\n", "moves before every head is said to be raised or lowered"),
        (b"M280 P1 S10\n", b"M105\n", "plunger moves of a raised head"),
        (
            b"M400\nM280 P0 S90\nG4 P50\n",
            b"M280 P0 S90\nM105\n",
            "heads raised or lowered while the carriage may still move",
        ),
    ],
)
def test_what_is_left_out_is_found(old, new, name):
    assert old in DATA
    assert name in refused(data=DATA.replace(old, new, 1))


def test_a_head_lowered_into_the_print_is_found():
    low = DATA.replace(b"G0 Z20", b"G0 Z5.5")
    assert low != DATA
    assert "lowest tip where a head is lowered, above all that is written" in refused(data=low)


def test_a_swing_that_isn_t_waited_for_is_told():
    hasty = found(data=DATA.replace(b"G4 P50\n", b""))
    check = hasty["heads raised or lowered without their time waited for"]
    assert not check.passed
    assert check.weight == "warns"


def test_each_head_is_held_against_its_own_syringe():
    run = dry_run(DATA, QUICK, START)
    tiny = SYRINGES[1].model_copy(update={"volume_ul": 2.0, "dead_volume_ul": 0.0})
    loads = (SYRINGES[0], tiny)
    checks = check_each_head(run, QUICK, lambda k, view, one: syringe_checks(view, one, loads[k]))
    failed = [check.check for check in checks if check.refuses and "profile" not in check.check]
    assert failed == ["head 1 (right): ink, with 0 µL dead volume"]


def test_findings_of_heads_refuse_by_their_names():
    data = DATA.replace(b"M218 T1 X0 Y0 Z0", b"M218 T1 X40 Y0 Z0")
    run = dry_run(data, QUICK, START)
    failed = [check for check in gcode_checks(run, QUICK) if check.refuses]
    assert "offsets of a head that would count twice" in [check.check for check in failed]


# --- checks of plate wells, on handwritten jobs
PRINTER = load(Printer, "generic_marlin")
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
        "ways between wells, above the plate's rims": "line 9",
        "needle to its well's wall": "well A2, line 9",
    }
    assert value(low, "ways between wells") == 22


def test_the_wall_is_as_far_as_the_well_is_wide() -> None:
    lines = ["G0 Z2 F300", "G1 X55 E0.01 F300", "G0 Z23 F300"]
    gap = 15.62 / 2 - 5 - 0.31 / 2
    assert value(lines, "needle to its well's wall") == pytest.approx(gap)
    assert failed(["G0 Z2 F300", "G1 X56.9 E0.01 F300"]) == {
        "needle to its well's wall": "well A1, line 7"
    }


def test_a_hub_goes_into_a_well_only_where_it_fits() -> None:
    """Half an inch above 2 mm is 14.7 mm, below the rim at 17.4; 12 mm are taken for the hub."""
    assert failed(INTO_A1, needle=SHORT) == {"needle's hub to its well's wall": "well A1, line 7"}
    slim = SHORT.model_copy(update={"hub_outer_mm": 6.0})
    gap = 15.62 / 2 - 2 - 6 / 2
    assert value(INTO_A1, "needle's hub", needle=slim) == pytest.approx(gap)
    above = ["G0 Z4.8 F300", "G1 X52 E0.01 F300", "G0 Z23 F300"]  # 17.5 mm: over the rim
    assert failed(above, needle=SHORT) == {}


def test_the_bath_rises_by_ink_and_needle_and_must_not_run_over() -> None:
    area = math.pi / 4 * 15.62**2
    rise = (5.0 + math.pi / 4 * 0.31**2 * (8 - 2)) / area
    assert value(INTO_A1, "depth of a well's bath") == pytest.approx(8 + rise)
    full = replace(WELLS, bath_mm=17.4 - rise / 2)
    assert failed(INTO_A1, full) == {
        "depth of a well's bath with ink and needle in it, below its rim": (
            "well A1, plate.bath_depth_mm"
        )
    }


def test_writing_above_the_bath_and_a_hub_in_it_are_refused() -> None:
    assert failed(INTO_A1, replace(WELLS, bath_mm=1.5)) == {
        "highest writing in a well, below the bath's surface": "well A1, line 7"
    }
    stub = LONG.model_copy(update={"length_mm": 5.0, "hub_outer_mm": 1.0})
    assert failed(INTO_A1, needle=stub) == {
        "deepest tip in a well below the bath's surface, against the needle": "well A1, line 6"
    }


def test_a_well_that_holds_no_part_isn_t_entered() -> None:
    only = replace(WELLS, ink_ul={"A1": 5.0})
    assert failed([*INTO_A1, *TO_A2], only) == {
        "wells entered in which nothing is printed": "well A2, line 10"
    }
