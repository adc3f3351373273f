"""Well plates: positions, well names, travels, assignment."""

from __future__ import annotations

from itertools import pairwise
from math import dist
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from firmware_profiles import Plate, Printer, load, shipped
from printctl.errors import RecipeError
from printctl.pipeline.plate_plan import (
    assigned,
    expand,
    points,
    route,
    scanned_wells,
    standing_plate,
)
from printctl.recipe.plate import PlatePart

PLATE = load(Plate, "corning_24")
PRINTER = load(Printer, "generic_marlin")
STANDING = standing_plate(PLATE, PRINTER)


def names(*words: str) -> list[str]:
    return expand(words, PLATE, "plate.wells")


def part(**said: Any) -> PlatePart:
    return PlatePart(profile="corning_24", **said)


# --- plates ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [6, 12, 24, 48, 96])
def test_shipped_plates_have_their_wells_inside_the_standard_outside(count: int) -> None:
    plate = load(Plate, f"corning_{count}")
    assert len(plate.wells) == count
    assert (plate.length_mm, plate.width_mm) == pytest.approx((127.76, 85.48), abs=0.25)
    assert shipped(Plate).count(f"corning_{count}") == 1


def test_the_96_well_plate_is_the_standard_s() -> None:
    """ANSI/SLAS 4-2004: a pitch of 9 mm, the array in the middle of the plate."""
    plate = load(Plate, "corning_96")
    assert plate.offset_mm("A1") == pytest.approx((-11 * 4.5, 7 * 4.5))
    assert plate.offset_mm("H12") == pytest.approx((11 * 4.5, -7 * 4.5))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"well_x_mm": 20.0, "well_y_mm": 20.0}, "don't fit beside each other"),
        ({"a1_x_mm": 5.0}, "beyond the plate"),
        ({"columns": 7}, "beyond the plate"),
        ({"well_y_mm": 15.0}, "a round well"),
        ({"well_depth_mm": 30.0}, "is above height_mm"),
    ],
)
def test_a_plate_that_can_t_be_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        Plate.model_validate(PLATE.model_dump() | changes)


def test_a_turned_plate_has_a1_where_one_sees_it() -> None:
    """Behind on the left; a quarter against the clock in front on the left; and so on."""
    signs = [
        tuple(
            at > middle
            for at, middle in zip(
                standing_plate(PLATE, PRINTER, turned_deg=turn).centre_mm("A1"),
                (100, 100),
                strict=True,
            )
        )
        for turn in (0, 90, 180, 270)
    ]
    assert signs == [(False, True), (False, False), (True, False), (True, True)]
    box = load(Plate, "corning_6").model_copy(update={"shape": "box", "well_y_mm": 30.0})
    turned = standing_plate(box, PRINTER, turned_deg=90).dish
    assert (turned.inner_x_mm, turned.inner_y_mm) == (30.0, 34.8)


@pytest.mark.parametrize("turn", [0, 90, 180, 270])
def test_a1_stands_where_the_recipe_says(turn: int) -> None:
    standing = standing_plate(PLATE, PRINTER, (60.0, 80.0), turn)
    assert standing.centre_mm("A1") == (60.0, 80.0)
    assert dist(standing.centre_mm("A2"), (60, 80)) == pytest.approx(19.3)


def test_a_plate_too_high_for_the_printer_is_refused() -> None:
    low = PRINTER.model_copy(
        update={"z_mm": PRINTER.z_mm.model_copy(update={"low": 0.0, "high": 21.0})}
    )
    with pytest.raises(RecipeError, match=r"above the 21 mm of .* take a lower plate"):
        standing_plate(PLATE, low)


# --- names and ways -------------------------------------------------------------------------------


def test_wells_are_named_one_by_one_along_a_row_and_as_a_block() -> None:
    assert names("A1", "b2..b4", "C01") == ["A1", "B2", "B3", "B4", "C1"]
    assert names("A5..B6") == ["A5", "A6", "B5", "B6"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["Z9"], "Z9 isn't on Corning Costar 24-well plate.* rows A to D and columns 1 to 6"),
        (["A7"], "A7 isn't on"),
        (["A1..D9"], "D9 isn't on"),
        (["one"], "'one' is no well"),
        (["A1", "A1..A3"], "names A1 twice"),
        (["B3..A1"], r"runs backwards; .* A1\.\.B3"),
    ],
)
def test_wells_that_aren_t_there_are_refused(words: list[str], message: str) -> None:
    with pytest.raises(RecipeError, match=message):
        names(*words)


def length(wells: list[str]) -> float:
    return sum(dist(STANDING.centre_mm(a), STANDING.centre_mm(b)) for a, b in pairwise(wells))


@given(st.sets(st.sampled_from(PLATE.wells), min_size=1))
def test_the_way_visits_each_well_once_and_isn_t_longer_than_row_by_row(wells: set[str]) -> None:
    found = route(sorted(wells), STANDING)
    assert sorted(found) == sorted(wells)
    assert length(found) <= length(sorted(wells)) + 1e-9


def test_the_way_over_a_whole_plate_goes_from_neighbour_to_neighbour() -> None:
    assert length(route(PLATE.wells, STANDING)) == pytest.approx(23 * 19.3)


# --- variants -------------------------------------------------------------------------------------


def test_a_grid_holds_every_pair_and_a_list_only_those_named() -> None:
    sweep = {"toolpath.write_speed_mm_s": (3, 5), "seed": (1, 2)}
    assert [tuple(point.values.values()) for point in points(sweep, "grid")] == [
        (3, 1), (3, 2), (5, 1), (5, 2),
    ]  # fmt: skip
    assert [point.label for point in points(sweep, "list")] == [
        "write speed 3 mm/s, seed 1",
        "write speed 5 mm/s, seed 2",
    ]
    assert [point.values for point in points({}, "grid")] == [{}]


@pytest.mark.parametrize(
    ("sweep", "words"),
    [
        ({"toolpath.needle": ("30g", "25g")}, "can't differ from well to well"),
        ({"toolpath.prime.line_mm": (5, 10)}, "can't differ from well to well"),
        ({"printer.bath": ("a", "b")}, "isn't among what can be varied"),
        ({"scan.seed": (1, 2)}, "isn't among what can be varied"),
        ({"ink.viscosity_pa_s": (1, 2)}, "isn't among what can be varied"),
        ({"toolpath": (1, 2)}, "isn't among what can be varied"),
        ({"seed": (1, 2, 1)}, "holds seed 1 more than once"),
    ],
)
def test_what_no_sweep_can_vary_is_refused(sweep: dict[str, Any], words: str) -> None:
    with pytest.raises(RecipeError, match=words):
        points(sweep, "grid")


def where(**said: Any) -> dict[str, tuple[int, int]]:
    return {well.name: (well.variant, well.copy) for well in assigned(part(**said), PLATE)}


def test_copies_follow_each_other_in_whole_rounds() -> None:
    assert where(sweep={"seed": [1, 2]}, copies=2) == {
        "A1": (0, 1), "A2": (1, 1), "A3": (0, 2), "A4": (1, 2),
    }  # fmt: skip
    assert where(sweep={"seed": [1, 2]}, wells=["D6", "A1..A3"]) == {
        "D6": (0, 1), "A1": (1, 1), "A2": (0, 2), "A3": (1, 2),
    }  # fmt: skip
    assert where(wells="all") == {name: (0, k + 1) for k, name in enumerate(PLATE.wells)}
    assert where() == {"A1": (0, 1)}
    assert list(where(wells="B2, C1..C2")) == ["B2", "C1", "C2"]


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"sweep": {"seed": [1, 2]}, "wells": ["A1..A3"]}, "names 3 wells, and 2 variants"),
        ({"copies": 3, "wells": ["A1..A2"]}, "names 2 wells, and 1 variants with 3 copies"),
        ({"copies": 25}, "make 25 parts, and .* has 24 wells"),
    ],
)
def test_wells_that_don_t_come_out_even_are_refused(said: dict[str, Any], words: str) -> None:
    with pytest.raises(RecipeError, match=words):
        assigned(part(**said), PLATE)


def test_an_empty_well_can_t_be_scanned() -> None:
    asked = part(wells=["B1..B3"], scanned=["B3", "B2"])
    assert scanned_wells(asked, PLATE, assigned(asked, PLATE)) == ["B2", "B3"]
    asked = part(wells=["B1..B3"], scanned=["A1"])
    with pytest.raises(RecipeError, match="A1, in which nothing is printed"):
        scanned_wells(asked, PLATE, assigned(asked, PLATE))
