"""Preflight checks one by one: each refuses or warns about exactly one fault.

What a job in order is warned of (none of our inks is measured, say) is taken away first.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from firmware_profiles import Bath, Dish, Ink, Needle, Printer, Syringe, load
from printctl.checks.preflight import Check, PlacedDish, SetUp, file_checks
from sim.gcode.dry_run.run import dry_run

START = (100.0, 100.0, 20.0)
PRINTER = load(Printer, "generic_marlin")
INK = load(Ink, "collagen_fresh")
HEAD = ["M85 S600", "G21", "G90", "M82", "M302 P1", "G92 X100 Y100 Z20 E0"]
BODY = ["G1 Z5 F240", "G1 X105 E0.02 F600", "G1 X100 E0.04", "G1 Z20 F240", "M400"]
GOOD = SetUp(
    PRINTER,
    load(Syringe, "hamilton_1ml"),
    INK,
    load(Needle, "30g_50mm"),
    load(Bath, "gelatin_support"),
    PlacedDish(load(Dish, "box_80mm"), START[:2], 0.0, 8.0),
)


def failing(head: list[str], body: list[str], mounted: SetUp) -> list[Check]:
    run = dry_run("\n".join([*head, *body]).encode(), mounted.printer, START)
    return [check for check in file_checks(run, mounted) if not check.passed]


def changed(part: str, **values: Any) -> SetUp:
    profile = getattr(GOOD, part)
    return replace(GOOD, **{part: profile.model_copy(update=values)})


def sure(**values: Any) -> Ink:
    """Ink as if it had been measured."""
    return INK.model_copy(update={"calibrated": True, "starting_values": (), **values})


def test_a_job_in_order_passes_all() -> None:
    assert failing(HEAD, BODY, GOOD) == []


LOW_DISH = load(Dish, "box_80mm").model_copy(update={"wall_mm": 7.5})
SHALLOW = replace(GOOD, standing=PlacedDish(LOW_DISH, START[:2], 0.0, 8.0))

JOBS: list[tuple[str, list[str]]] = [
    ("x, lowest", ["G0 Z100 F240", "G0 X-1 F6000"]),
    ("x, highest", ["G0 Z100 F240", "G0 X201 F6000"]),
    ("y, lowest", ["G0 Z100 F240", "G0 Y-1 F6000"]),
    ("y, highest", ["G0 Z100 F240", "G0 Y201 F6000"]),
    ("z, highest", ["G0 Z201 F240"]),
    ("speed of x", ["G0 X110 F24000"]),
    ("speed of y", ["G0 Y110 F24000"]),
    ("speed of z", ["G0 Z19 F600"]),
    ("speed of e", ["G1 E1 F600"]),
    ("plunger behind where it begins", ["G1 E-1 F60"]),
    ("longest line as sent", ["M117 " + "a long text " * 8]),
    ("moves below the planner's least", ["G1 X100.05 F600", "G1 X101"]),
    ("too_slow", ["G1 X101 F12"]),
    ("commands unknown to the firmware", ["M42 P4 S1"]),
    ("lines that are no command", ["hello"]),
    ("homing with the needle mounted", ["G28 X"]),
    ("arcs without a centre", ["G2 X101 Y101 F600"]),
    ("warmest setting of the ink", ["M104 S37"]),
    ("coldest setting of the ink", ["M104 S1"]),
    ("warmest setting of the bath", ["M190 S30"]),
    ("lowest tip above the dish's floor", ["G0 Z0.5 F240"]),
    ("needle to the dish's wall", ["G0 Z48 F240", "G0 X139.5 F600"]),
    ("highest writing", ["G1 X101 E0.1 F600"]),
    ("the firmware's own switch-off", ["M85 S0"]),
    ("the firmware's own switch-off, above", ["G4 S700"]),
]


@pytest.mark.parametrize(("name", "lines"), JOBS)
def test_a_job_that_is_wrong_in_one_thing_is_told_of_that_alone(
    name: str, lines: list[str]
) -> None:
    found = failing(HEAD, [*BODY, *lines], GOOD)
    assert [check.check[: len(name)] for check in found] == [name]
    (check,) = found
    told = len(HEAD) + len(BODY) + len(lines)
    first = told - len(lines) + 1
    assert any(f"line {line}" in check.place for line in range(first, told + 1)), check.place
    assert check.remedy


def test_z_lowest_is_told_beside_the_floor_it_means() -> None:
    names = [check.check for check in failing(HEAD, [*BODY, "G0 Z-1 F240"], GOOD)]
    assert names == ["z, lowest", "lowest tip above the dish's floor"]


def test_the_plunger_s_travel_is_a_check_of_its_own() -> None:
    (check,) = failing(HEAD, BODY, changed("printer", plunger_travel_mm=0.03))
    assert check.check == "plunger travel"
    small = replace(changed("syringe", volume_ul=41, inner_mm=1.0), thinnest_bore=0.05)
    (check,) = failing(HEAD, [*BODY, "G1 E30 F60"], small)
    assert check.check.startswith("ink, with")


def test_plunger_moves_that_are_cold_are_refused_alone() -> None:
    (check,) = failing([line for line in HEAD if "M302" not in line], BODY, GOOD)
    assert check.check == "plunger moves that the firmware would drop"


@pytest.mark.parametrize(
    ("name", "mounted"),
    [
        ("what sets the ink", replace(GOOD, bath=load(Bath, "gelatin_calcium"))),
        ("printing temperature of the bath", changed("bath", max_printing_c=37.0)),
        ("depth of the bath with ink and needle in it, below", SHALLOW),
        ("deepest tip below", changed("needle", length_mm=2.0)),
        ("dish", replace(GOOD, standing=None)),
        ("pressure in the syringe", changed("syringe", max_pressure_kpa=1.0)),
        ("force on the plunger", changed("printer", max_plunger_force_n=0.1)),
        ("shear stress at the needle's wall", replace(GOOD, ink=sure(max_shear_stress_pa=1.0))),
        ("pressure that the ink holds", changed("ink", retract_ul=0.0, yield_stress_pa=10.0)),
        ("set-up", replace(GOOD, needle=None, bath=GOOD.bath)),
        ("commands of the safe state", changed("printer", safe_state_off=("M42 P4 S0",))),
        (
            "profile",
            replace(changed("syringe", inner_mm=0.461, volume_ul=1000.0), thinnest_bore=0.05),
        ),
        ("profile", changed("printer", max_line_bytes=200)),
        ("profile", replace(GOOD, ink=INK.model_copy(update={"calibrated": True}))),
        ("profile", changed("needle", outer_mm=0.17)),
    ],
)
def test_a_set_up_that_is_wrong_in_one_thing_is_told_of_that_alone(
    name: str, mounted: SetUp
) -> None:
    found = [check.check[: len(name)] for check in failing(HEAD, BODY, mounted)]
    assert set(found) == {name}
