"""Checks of plate wells, on handwritten jobs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from firmware_profiles import Needle, Plate, Printer, load
from printctl.checks.preflight import Check, Wells, well_checks
from sim.gcode.dry_run.run import dry_run

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
