"""Checks of a pneumatic head: each refuses one faulty job or set-up."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from firmware_profiles import Bath, Dish, Ink, MeasuredFlow, Needle, Printer, Span, Syringe, load
from printctl.checks.preflight import Check, PlacedDish, SetUp, file_checks
from sim.gcode.dry_run.run import dry_run

START = (100.0, 100.0, 20.0)
INK, NEEDLE = load(Ink, "collagen_fresh"), load(Needle, "30g_50mm")
BASE = load(Printer, "pneumatic_marlin")
HEAD = BASE.pneumatic
assert HEAD is not None
MEASURED = MeasuredFlow(flow_ul_s=0.1, pressure_kpa=80, ink=INK.name, needle=NEEDLE.name)
GOOD = SetUp(
    BASE.model_copy(update={"dispenser": HEAD.model_copy(update={"measured": MEASURED})}),
    load(Syringe, "hamilton_1ml").model_copy(update={"max_pressure_kpa": 300.0}),
    INK,
    NEEDLE,
    load(Bath, "gelatin_support"),
    PlacedDish(load(Dish, "box_80mm"), START[:2], 0.0, 8.0),
)
WATCH = "kill and dead host"
"""What everybody with such a head is told."""
BEGIN = ["M85 S600", "M106 P0 S0", "G21", "G90", "G92 X100 Y100 Z20", "G0 Z5 F240"]
WRITE = ["M400", "M106 P0 S255", "G4 P30", "G1 X105 F600", "M400", "M106 P0 S0", "G4 P30"]
END = ["G0 Z20 F240", "M400"]


def failing(lines: list[str], mounted: SetUp = GOOD) -> list[Check]:
    run = dry_run("\n".join(lines).encode(), mounted.printer, START)
    checks = [check for check in file_checks(run, mounted) if not check.passed]
    told = [check for check in checks if check.place == WATCH]
    assert [check.refuses for check in told] == [False]
    return [check for check in checks if check.place != WATCH]


def head(**changes: Any) -> SetUp:
    dispenser = GOOD.printer.dispenser.model_copy(update=changes)
    return replace(GOOD, printer=GOOD.printer.model_copy(update={"dispenser": dispenser}))


def other(part: str, **changes: Any) -> SetUp:
    return replace(GOOD, **{part: getattr(GOOD, part).model_copy(update=changes)})


TORRENT = head(measured=MEASURED.model_copy(update={"flow_ul_s": 2e3}), closing_delay_s=0.0)
DROPS = head(measured=MEASURED.model_copy(update={"flow_ul_s": 2.0}))


def test_a_job_in_order_passes_all() -> None:
    assert failing([*BEGIN, *WRITE, *END]) == []


def without(lines: list[str], *taken: str) -> list[str]:
    return [line for line in lines if line not in taken]


@pytest.mark.parametrize(
    ("name", "lines", "line"),
    [
        ("moves before the valve is closed", [*without(BEGIN, "M106 P0 S0"), *WRITE, *END], 5),
        ("travels with the valve open", [*BEGIN, *WRITE[:4], "G0 X100", *WRITE[4:], *END], 11),
        ("plunger moves, where there is none", [*BEGIN, *WRITE, "G1 E1 F60", *END], 14),
        ("commands that set the valve", [*BEGIN, *WRITE, "M400", "M106 P0 S9", "G4 P30",
                                         "M106 P0 S0", "G4 P30", *END], 15),
        ("valve open at the end", [*BEGIN, *WRITE, *END, "M106 P0 S255"], 16),
        ("valve switched while the head may", [*BEGIN, *WRITE[1:], *END], 7),
        ("valve switched without its delay", [*BEGIN, *WRITE[:2], *WRITE[3:], *END], 8),
    ],
)  # fmt: skip
def test_a_job_that_is_wrong_in_one_thing_is_told_of_that_alone(
    name: str, lines: list[str], line: int
) -> None:
    found = failing(lines)
    told = [check.check[: len(name)] for check in found if "cold" not in check.check]
    told = [text for text in told if not text.startswith("plunger moves that")]
    assert told == [name]
    assert any(check.place.startswith(f"line {line}") for check in found)


@pytest.mark.parametrize(
    ("name", "mounted", "refuses"),
    [
        ("pressure, of the regulator", head(max_pressure_kpa=70.0), True),
        ("pressure, on the syringe", other("syringe", max_pressure_kpa=79.0), True),
        ("shear stress", other("ink", max_shear_stress_pa=63.0), True),
        ("asked of you", other("syringe", max_pressure_kpa=None), False),
        ("flow at the set pressure", head(measured=None), False),
        ("flow at the set pressure", head(pressure_kpa=90.0), False),
        ("flow at the set pressure",
         replace(head(measured=None), ink=INK.model_copy(update={"yield_stress_pa": 64.0})), True),
        ("ink for the open valve", TORRENT, True),
        ("drop at each path's end", DROPS, False),
        ("fastest writing", other("ink", write_speed_mm_s=Span(low=1, high=9)), False),
        ("slowest writing", other("ink", write_speed_mm_s=Span(low=11, high=19)), False),
        ("profile", replace(GOOD, printer=GOOD.printer.model_copy(update={"safe_state_off": ()})),
         True),
    ],
)  # fmt: skip
def test_a_set_up_that_is_wrong_in_one_thing_is_told_of_that_alone(
    name: str, mounted: SetUp, refuses: bool
) -> None:
    found = failing([*BEGIN, *WRITE, *END], mounted)
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
