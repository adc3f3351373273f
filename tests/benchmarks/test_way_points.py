"""Way points: a move that is lost, doubled or left away is told; a look's way up and back isn't."""

import numpy as np
import pytest

from benchmarks.firmware.board import AXES, RECORD, StepLog
from benchmarks.firmware.files import follow, way_points

FILE = ["G92 X5 Y5 Z1 E0", "G1 X6 Y5.5 E0.1", "G1 X6.05", "G1 Z1.5", "G92 E3", "G1 X5 E3.1"]
MADE = [("X", 80), ("Y", 40), ("E", 50), ("X", 4), ("Z", 200), ("X", -84), ("E", 50)]


def log_of(*moves: tuple[str, int]) -> StepLog:
    """A log of these many steps, one motor after the other."""
    edges = [(AXES.index(axis), np.sign(count)) for axis, count in moves for _ in range(abs(count))]
    records = np.zeros(len(edges), RECORD)
    records["axis"] = [axis for axis, _ in edges]
    records["direction"] = [direction for _, direction in edges]
    records["enabled"] = 1
    return StepLog(records)


def test_a_move_below_the_least_goes_with_the_next_and_a_way_up_and_back_is_an_excursion():
    ways = way_points(FILE)
    assert ways == [(80, 40, 0, 50), (84, 40, 200, 50), (0, 40, 200, 100)]
    assert follow(log_of(*MADE), ways).exact
    up = [("E", -20), ("Z", 300), ("Z", -300), ("E", 20)]
    found = follow(log_of(*MADE[:3], *up, *MADE[3:], *up), way_points(FILE))
    assert found.exact
    assert found.excursions == 2


@pytest.mark.parametrize(
    "made",
    [MADE[:-2], [*MADE, ("X", 10)], [*MADE[:3], ("Z", 200), *MADE[5:]], [*MADE[:2], *MADE[3:]]],
    ids=["the last is missing", "one too many", "beside", "no ink"],
)
def test_what_else_the_motors_made_isnt_exact(made):
    assert not follow(log_of(*made), way_points(FILE)).exact
