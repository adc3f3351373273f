"""Declarations about the printer (mounted parts, positions), and what they invalidate."""

from __future__ import annotations

import pytest

from firmware_profiles import Printer, load
from printctl.machine.link.errors import Refused
from printctl.machine.station.known_state import Knowledge

PRINTER = load(Printer, "generic_marlin")


@pytest.fixture
def known() -> Knowledge:
    found = Knowledge(PRINTER)
    found.homed = (True, True, True)
    found.mount({"needle": "25g", "syringe": "bd_1ml", "dish": "petri_60mm"})
    return found


def test_naming_the_needle_that_is_there_keeps_the_position(known):
    assert known.trusted


def test_another_needle_has_another_length(known):
    known.mount({"floor_mm": 3.0})
    known.mount({"needle": "25g"})
    assert known.trusted, "it is the same"
    known.mount({"needle": "27g"})
    assert known.homed == (True, True, False)
    assert known.mounted.floor_mm is None


def test_a_needle_put_on_after_homing_has_a_length_that_nobody_knows():
    known = Knowledge(PRINTER)
    known.home({"x", "y", "z"})
    assert known.trusted
    known.mount({"needle": "25g"})
    assert not known.trusted


def test_heights_and_places_go_along_with_a_new_count(known):
    known.mount({"floor_mm": 3.0, "bath_level_mm": 9.0, "dish_centre_mm": (100, 90)})
    known.count_anew((10, 10, 10), (11, 10, 8), {"x", "z"})
    assert known.mounted.floor_mm == 1.0
    assert known.mounted.bath_level_mm == 7.0
    assert known.mounted.dish_centre_mm == (101, 90)


def test_place_of_the_dish_was_told_in_the_true_frame(known):
    known.lose_position()
    known.mount({"dish_centre_mm": (100, 90)})
    known.count_anew((0, 0, 0), (50, 60, 70), {"x", "y", "z"})
    assert known.mounted.dish_centre_mm == (100, 90)
    assert known.trusted


def test_syringe_that_is_named_is_full_unless_said_otherwise(known):
    assert known.plunger_mm == 0
    known.mount({"syringe": "bd_3ml", "plunger_mm": 12.5})
    assert known.plunger_mm == 12.5
    known.mount({"ink": "carbopol"})
    assert known.plunger_mm == 12.5, "another ink's name doesn't fill it"


@pytest.mark.parametrize(
    "said",
    [
        {"plunger_mm": -1},
        {"plunger_mm": "full"},
        {"needle": 3},
        {"dish_centre_mm": [1]},
        {"dish_centre_mm": [1, None]},
        {"floor_mm": float("nan")},
        {"bath_level_mm": True},
        {"dish": "bucket"},
        {"glove": "left"},
    ],
)
def test_nonsense_is_refused_and_changes_nothing(known, said):
    before = (known.mounted, known.plunger_mm, known.homed, known.profiles)
    with pytest.raises(Refused):
        known.mount(said)
    assert (known.mounted, known.plunger_mm, known.homed, known.profiles) == before
