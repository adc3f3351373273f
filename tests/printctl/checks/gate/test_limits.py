"""Soft limits of manual moves, against an oracle that samples the path."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from firmware_profiles import Dish, Needle, Printer, load
from printctl.checks.gate.inputs import (
    IN_DISH_MM_S,
    RIM_MARGIN_MM,
    STEP_ASIDE_MM,
    STEP_DOWN_MM,
    Bounds,
    NotAllowed,
    check_move,
    check_speed,
    reach,
)

PRINTER = load(Printer, "generic_marlin")
NEEDLE = load(Needle, "25g")
DISHES = {name: load(Dish, name) for name in ("petri_60mm", "petri_35mm", "chamber_slide")}
FLOOR = 3.0
NM = 1e-6


def bounds(dish: str = "petri_60mm", **changed: object) -> Bounds:
    told = {
        "trusted": True,
        "needle": NEEDLE,
        "dish": DISHES[dish],
        "centre_mm": (100.0, 100.0),
        "floor_mm": FLOOR,
    }
    return Bounds(PRINTER, **{**told, **changed})  # type: ignore[arg-type]


def refused(why: str, known: Bounds, start: tuple, target: tuple) -> None:
    with pytest.raises(NotAllowed, match=why):
        check_move(known, start, target)


coordinate = st.floats(-10, 210)
place = st.tuples(coordinate, coordinate, st.floats(-5, 60))
near = st.tuples(st.floats(60, 140), st.floats(60, 140), st.floats(0, 30))


@given(st.sampled_from(sorted(DISHES)), place | near, near | place)
def test_no_accepted_move_touches_dish_or_leaves_the_machine(name, start, target):
    known = bounds(name)
    try:
        check_move(known, start, target)
    except NotAllowed:
        return
    moved = [mm for mm, was in zip(target, start, strict=True) if mm != was]
    assert all(-NM <= mm <= 200 + NM for mm in moved)
    if math.dist(start[:2], target[:2]) <= NM and target[2] >= start[2]:
        return  # straight up
    assert target[2] >= FLOOR - NM
    dish = DISHES[name]
    way = np.linspace(start, target, 60)
    low = way[way[:, 2] < FLOOR + dish.wall_mm]
    off = np.abs(low[:, :2] - 100)
    half = np.array([dish.inner_x_mm, dish.inner_y_mm]) / 2
    room = half[0] - np.hypot(*off.T) if dish.shape == "round" else (half - off).min(axis=1)
    assert (room >= NEEDLE.outer_mm / 2 - 1e-6).all(), "the shaft would be in the wall"


@given(near, st.floats(0, 100))
def test_straight_up_is_free_from_wherever_the_tip_is(start, by):
    known = bounds(part_in_dish=True)
    assume(start[2] + by <= 200)
    check_move(known, start, (start[0], start[1], start[2] + by))


@given(near, st.sampled_from(sorted(DISHES)))
def test_reach_is_what_may_be_reached(at, name):
    known = bounds(name)
    low, high = reach(known, at)
    for axis in range(3):
        for end in (low[axis], high[axis]):
            target = (*at[:axis], end, *at[axis + 1 :])
            check_move(known, at, target)
        assert low[axis] <= at[axis] <= high[axis]


def test_floor_is_where_it_was_touched():
    refused(r"Z 2.90 mm is below the dish's floor.*3.00", bounds(), (100, 100, 4), (100, 100, 2.9))
    check_move(bounds(), (100, 100, 4), (100, 100, 3.0))


def test_wall_is_crossed_above_the_rim_only():
    over = FLOOR + DISHES["petri_60mm"].wall_mm + RIM_MARGIN_MM + 0.01
    check_move(bounds(), (100, 100, over), (150, 100, over))
    refused("of the wall of", bounds(), (100, 100, over - 0.1), (150, 100, over - 0.1))
    refused("of the wall of", bounds(), (150, 100, over), (150, 100, over - 5))


def test_hub_stays_clear_of_the_wall_too():
    tip = FLOOR + 0.5
    short = NEEDLE.model_copy(update={"length_mm": 8.0, "hub_outer_mm": 12.0})
    edge = 100 + DISHES["petri_60mm"].inner_x_mm / 2 - 4
    check_move(bounds(), (100, 100, tip), (edge, 100, tip))
    refused("needle's hub", bounds(needle=short), (100, 100, tip), (edge, 100, tip))


def test_untrusted_position_allows_small_steps_and_up():
    known = Bounds(PRINTER)
    check_move(known, (0, 0, 0), (0, 0, 150))
    check_move(known, (0, 0, 0), (STEP_ASIDE_MM, 0, 0))
    check_move(known, (0, 0, 0), (0, 0, -STEP_DOWN_MM))
    refused("aside in one step, at most 10", known, (0, 0, 0), (11, 0, 0))
    refused("down in one step, at most 1 mm.*isn't trusted", known, (0, 0, 0), (0, 0, -1.1))
    refused("longer than the axis", known, (0, 0, 0), (0, 0, 201))


@pytest.mark.parametrize(
    ("missing", "why"), [("floor_mm", "isn't touched off"), ("centre_mm", "where the dish stands")]
)
def test_unknown_dish_allows_small_steps(missing, why):
    known = bounds(**{missing: None})
    check_move(known, (100, 100, 6), (101, 100, 6))
    refused(why, known, (100, 100, 6), (102, 100, 6))
    refused(why, known, (100, 100, 6), (100, 100, 4.5))


def test_bath_that_holds_a_print_is_left_straight_up():
    known = bounds(part_in_dish=True, bath_level_mm=9.0)
    refused("holds a print", known, (100, 100, 8), (101, 100, 8))
    refused("holds a print", known, (100, 100, 10), (100, 100, 8.9))
    check_move(known, (100, 100, 9.5), (101, 100, 9.5))


def test_without_needle_nothing_but_the_machine_limits():
    check_move(bounds(needle=None), (100, 100, 50), (0, 0, 0))
    refused("outside 0 to 200", bounds(needle=None), (100, 100, 50), (0, 0, -0.1))


@given(near, near, st.floats(0.1, 400))
def test_accepted_speeds_are_within_each_axis(start, target, speed):
    assume(math.dist(start, target) > 0.01)
    known = bounds()
    try:
        check_speed(known, start, target, speed)
    except NotAllowed:
        return
    part = np.abs(np.subtract(target, start)) / math.dist(start, target) * speed
    limits = [getattr(PRINTER.max_speed_mm_s, axis) for axis in "xyz"]
    assert (part <= np.array(limits) * (1 + 1e-6)).all()
    if min(start[2], target[2]) < FLOOR + DISHES["petri_60mm"].wall_mm:
        assert speed <= IN_DISH_MM_S * (1 + 1e-6)


@pytest.mark.parametrize("speed", [0.0, -1.0, math.nan, math.inf])
def test_speed_that_is_none_is_refused(speed):
    with pytest.raises(NotAllowed, match=r"above 0|exceeds"):
        check_speed(bounds(), (100, 100, 50), (110, 100, 50), speed)
