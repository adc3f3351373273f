"""Preflight checks one by one: each refuses or warns about exactly one fault.

What a job in order is warned of (none of our inks is measured, say) is taken away first.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from firmware_profiles import Bath, Dish, Ink, MeasuredFlow, Needle, Printer, Span, Syringe, load
from gcode.dry_run.run import dry_run
from printctl.checks.preflight import Check, PlacedDish, SetUp, file_checks

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


def failing(lines: list[str], mounted: SetUp = GOOD) -> list[Check]:
    run = dry_run("".join(f"{line}\n" for line in lines).encode(), mounted.printer, START)
    return [check for check in file_checks(run, mounted) if not check.passed]


def changed(part: str, base: SetUp = GOOD, **values: Any) -> SetUp:
    return replace(base, **{part: getattr(base, part).model_copy(update=values)})


def sure(**values: Any) -> SetUp:
    """Ink as if it had been measured."""
    return changed("ink", calibrated=True, starting_values=(), **values)


def test_a_job_in_order_passes_all() -> None:
    assert failing([*HEAD, *BODY]) == []


LOW_DISH = load(Dish, "box_80mm").model_copy(update={"wall_mm": 7.5})
SHALLOW = replace(GOOD, standing=PlacedDish(LOW_DISH, START[:2], 0.0, 8.0))

JOBS: list[tuple[str, list[str]]] = [
    ("x, lowest", ["G0 Z100 F240", "G0 X-1 F6000"]),
    ("x, highest", ["G0 Z100 F240", "G0 X201 F6000"]),
    ("y, lowest", ["G0 Z100 F240", "G0 Y-1 F6000"]),
    ("y, highest", ["G0 Z100 F240", "G0 Y201 F6000"]),
    ("z, highest", ["G0 Z201 F240"]),
    ("X speed", ["G0 X110 F24000"]),
    ("Y speed", ["G0 Y110 F24000"]),
    ("Z speed", ["G0 Z19 F600"]),
    ("E speed", ["G1 E1 F600"]),
    ("plunger retracted behind its start", ["G1 E-1 F60"]),
    ("longest line sent", ["M117 " + "a long text " * 8]),
    ("moves shorter than 6 motor steps", ["G1 X100.05 F600", "G1 X101"]),
    ("too_slow", ["G1 X101 F12"]),
    ("commands unknown to the firmware", ["M42 P4 S1"]),
    ("lines that are not commands", ["hello"]),
    ("homing with the needle mounted", ["G28 X"]),
    ("invalid arcs", ["G2 X101 Y101 F600"]),
    ("highest ink temperature", ["M104 S37"]),
    ("lowest ink temperature", ["M104 S1"]),
    ("highest bath temperature", ["M190 S30"]),
    ("lowest tip above the dish floor", ["G0 Z0.5 F240", "G0 Z20"]),
    ("needle to dish wall", ["G0 Z48 F240", "G0 X139.5 F600"]),
    ("highest extrusion", ["G1 X105 E0.06 F600", "G0 Z25 F240"]),
    ("firmware idle timeout", ["M85 S0"]),
    ("firmware idle timeout vs.", ["G4 S700"]),
]


@pytest.mark.parametrize(("name", "lines"), JOBS)
def test_a_job_that_is_wrong_in_one_thing_is_told_of_that_alone(
    name: str, lines: list[str]
) -> None:
    found = failing([*HEAD, *BODY, *lines])
    assert [check.check[: len(name)] for check in found] == [name]
    (check,) = found
    told = len(HEAD) + len(BODY) + len(lines)
    first = told - len(lines) + 1
    assert any(f"line {line}" in check.place for line in range(first, told + 1)), check.place
    assert check.remedy


def test_z_lowest_is_told_beside_the_floor_it_means() -> None:
    names = [check.check for check in failing([*HEAD, *BODY, "G0 Z-1 F240", "G0 Z20"])]
    assert names == ["z, lowest", "lowest tip above the dish floor"]


def test_the_plunger_s_travel_is_a_check_of_its_own() -> None:
    (check,) = failing([*HEAD, *BODY], changed("printer", plunger_travel_mm=0.03))
    assert check.check == "plunger travel"
    small = replace(changed("syringe", volume_ul=41, inner_mm=1.0), thinnest_bore=0.05)
    (check,) = failing([*HEAD, *BODY, "G1 E30 F60"], small)
    assert check.check.startswith("ink incl.")


def test_plunger_moves_that_are_cold_are_refused_alone() -> None:
    (check,) = failing([line for line in [*HEAD, *BODY] if "M302" not in line])
    assert check.check == "plunger moves that the firmware would ignore"


@pytest.mark.parametrize(
    ("name", "mounted"),
    [
        ("gelation triggers", replace(GOOD, bath=load(Bath, "gelatin_calcium"))),
        ("bath printing temperature", changed("bath", max_printing_c=37.0)),
        ("bath depth with ink and needle vs.", SHALLOW),
        ("immersion depth", changed("needle", length_mm=2.0)),
        ("dish", replace(GOOD, standing=None)),
        ("pressure in the syringe", changed("syringe", max_pressure_kpa=1.0)),
        ("plunger force", changed("printer", max_plunger_force_n=0.1)),
        ("shear stress at the needle wall", sure(max_shear_stress_pa=1.0)),
        ("residual pressure", changed("ink", retract_ul=0.0, yield_stress_pa=10.0)),
        ("set-up", replace(GOOD, needle=None, bath=GOOD.bath)),
        ("safe-state commands", changed("printer", safe_state_off=("M42 P4 S0",))),
        (
            "profile",
            replace(changed("syringe", inner_mm=0.461, volume_ul=1000.0), thinnest_bore=0.05),
        ),
        ("profile", changed("printer", max_line_bytes=200)),
        ("profile", changed("ink", calibrated=True)),
        ("profile", changed("needle", outer_mm=0.17)),
    ],
)
def test_a_set_up_that_is_wrong_in_one_thing_is_told_of_that_alone(
    name: str, mounted: SetUp
) -> None:
    found = [check.check[: len(name)] for check in failing([*HEAD, *BODY], mounted)]
    assert set(found) == {name}


# --- checks of a pneumatic head: each refuses one faulty job or set-up
BASE = load(Printer, "pneumatic_marlin")
AIR_HEAD = BASE.pneumatic
assert AIR_HEAD is not None
MEASURED = MeasuredFlow(flow_ul_s=0.1, pressure_kpa=80, ink=INK.name, needle=GOOD.needle.name)
AIR_GOOD = SetUp(
    BASE.model_copy(update={"dispenser": AIR_HEAD.model_copy(update={"measured": MEASURED})}),
    load(Syringe, "hamilton_1ml").model_copy(update={"max_pressure_kpa": 300.0}),
    INK,
    GOOD.needle,
    GOOD.bath,
    GOOD.standing,
)
WATCH = "emergency stop and dead host"
"""What everybody with such a head is told."""
BEGIN = ["M85 S600", "M106 P0 S0", "G21", "G90", "G92 X100 Y100 Z20", "G0 Z5 F240"]
WRITE = ["M400", "M106 P0 S255", "G4 P30", "G1 X105 F600", "M400", "M106 P0 S0", "G4 P30"]
END = ["G0 Z20 F240", "M400"]


def failing_air(lines: list[str], mounted: SetUp = AIR_GOOD) -> list[Check]:
    checks = failing(lines, mounted)
    assert [check.refuses for check in checks if check.place == WATCH] == [False]
    return [check for check in checks if check.place != WATCH]


def head(**changes: Any) -> SetUp:
    dispenser = AIR_GOOD.printer.dispenser.model_copy(update=changes)
    return other("printer", dispenser=dispenser)


def other(part: str, **values: Any) -> SetUp:
    return changed(part, AIR_GOOD, **values)


TORRENT = head(measured=MEASURED.model_copy(update={"flow_ul_s": 2e3}), closing_delay_s=0.0)
DROPS = head(measured=MEASURED.model_copy(update={"flow_ul_s": 2.0}))


def test_an_air_job_in_order_passes_all() -> None:
    assert failing_air([*BEGIN, *WRITE, *END]) == []


def without(lines: list[str], *taken: str) -> list[str]:
    return [line for line in lines if line not in taken]


@pytest.mark.parametrize(
    ("name", "lines", "line"),
    [
        ("moves before the valve is closed", [*without(BEGIN, "M106 P0 S0"), *WRITE, *END], 5),
        ("travels with the valve open", [*BEGIN, *WRITE[:4], "G0 X100", *WRITE[4:], *END], 11),
        ("plunger moves on a pneumatic head", [*BEGIN, *WRITE, "G1 E1 F60", *END], 14),
        ("commands that open the valve", [*BEGIN, *WRITE, "M400", "M106 P0 S9", "G4 P30",
                                         "M106 P0 S0", "G4 P30", *END], 15),
        ("valve open at the end", [*BEGIN, *WRITE, *END, "M106 P0 S255"], 16),
        ("valve switched while the head", [*BEGIN, *WRITE[1:], *END], 7),
        ("valve switched without its delay", [*BEGIN, *WRITE[:2], *WRITE[3:], *END], 8),
    ],
)  # fmt: skip
def test_an_air_job_that_is_wrong_in_one_thing_is_told_of_that_alone(
    name: str, lines: list[str], line: int
) -> None:
    found = failing_air(lines)
    told = [check.check[: len(name)] for check in found if "cold" not in check.check]
    told = [text for text in told if not text.startswith("plunger moves that")]
    assert told == [name]
    assert any(check.place.startswith(f"line {line}") for check in found)


@pytest.mark.parametrize(
    ("name", "mounted", "refuses"),
    [
        ("pressure vs. regulator", head(max_pressure_kpa=70.0), True),
        ("pressure vs. syringe", other("syringe", max_pressure_kpa=79.0), True),
        ("shear stress", other("ink", max_shear_stress_pa=63.0), True),
        ("operator check", other("syringe", max_pressure_kpa=None), False),
        ("flow at the set pressure", head(measured=None), False),
        ("flow at the set pressure", head(pressure_kpa=90.0), False),
        ("flow at the set pressure",
         replace(head(measured=None), ink=other("ink", yield_stress_pa=64.0).ink), True),
        ("ink for the open valve", TORRENT, True),
        ("drop diameter at path ends", DROPS, False),
        ("fastest extrusion move", other("ink", write_speed_mm_s=Span(low=1, high=9)), False),
        ("slowest extrusion move", other("ink", write_speed_mm_s=Span(low=11, high=19)), False),
        ("profile", other("printer", safe_state_on=("pump",)), True),
    ],
)  # fmt: skip
def test_an_air_set_up_that_is_wrong_in_one_thing_is_told_of_that_alone(
    name: str, mounted: SetUp, refuses: bool
) -> None:
    found = failing_air([*BEGIN, *WRITE, *END], mounted)
    assert [check.check[: len(name)] for check in found] == [name]
    assert found[0].refuses == refuses


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"pressure_kpa": 800}, "above what the regulator gives"),
        ({"closes": "M107"}, "one command with two"),
        ({"closes": "M106 P0 S255"}, "one command with two"),
        ({"opens": "G1 Z0"}, "opens"),
        ({"kind": "peristaltic"}, "peristaltic"),
        ({"valve": 1}, "valve"),
    ],
)
def test_a_head_that_can_t_be_is_refused(changes: dict[str, Any], says: str) -> None:
    values = BASE.model_dump(exclude_unset=True)
    values["dispenser"] = {**values["dispenser"], **changes}
    with pytest.raises(ValueError, match=says):
        Printer.model_validate(values)
