"""Clearance between needle and dish wall, for single and for many moves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_profiles import Dish, Needle, load
from printctl.checks.preflight.dish import hub_gap, wall_gap
from printctl.checks.set_up import PlacedDish, hub_gap_of, wall_gap_of

NEEDLE = load(Needle, "25g")
coordinate = st.floats(-50, 150)
place = st.tuples(coordinate, coordinate, st.floats(-5, 40))


@given(st.sampled_from(["petri_60mm", "chamber_slide"]), st.lists(st.tuples(place, place)))
def test_one_move_has_the_gap_that_it_has_among_many(name, moves):
    standing = PlacedDish(load(Dish, name), (40.0, 50.0), 3.0)
    tips, rows = np.array(moves).reshape(-1, 2, 3), np.ones(len(moves), np.bool_)
    alone = [wall_gap_of(ends, standing, 0.5) for ends in moves]
    assert alone == pytest.approx(wall_gap(tips, rows, standing, 0.5))
    alone = [hub_gap_of(ends, standing, NEEDLE) for ends in moves]
    assert alone == pytest.approx(hub_gap(tips, rows, standing, NEEDLE))
