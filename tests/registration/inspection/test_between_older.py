"""Missing ink on older ink, by the bath beside it along the line."""

from __future__ import annotations

import numpy as np
import pytest

from kernels.arrays import BoolArray, FloatArray
from registration.inspection import ExpectedLines, Unseen
from registration.inspection.gaps.between_older import infer_missing, is_contradicted
from registration.inspection.ways import Ways, lay_ways

WIDTH, PITCH, OLDER = 0.3, 0.4, 0.25
"""Of the line; of older lines across it, and how far each covers it, mm."""


def line() -> tuple[Ways, BoolArray]:
    """Places each 0.05 mm along a line of 8 mm, and which of them lie on older ink."""
    ways = lay_ways(
        ExpectedLines(
            np.array([[0.0, 0.0, 0.3]]), np.array([[8.0, 0.0, 0.3]]), np.array([WIDTH]),
            np.array([0]), np.array([0]), np.array([True]),
        ),
        0.05,
    )  # fmt: skip
    return ways, np.asarray(np.mod(ways.along, PITCH) < OLDER)


def inferred(ink: BoolArray) -> tuple[BoolArray, BoolArray]:
    """What is inferred of a line with ink at some places, and where older ink lies."""
    ways, older = line()
    why = np.where(older, int(Unseen.OLD_INK), int(Unseen.SEEN))
    present = np.where(older, np.nan, ink.astype(float))
    return infer_missing(present, ~older, why, ways, 1.0), older


def test_all_older_ink_of_a_missing_line_is_inferred_its_ends_too() -> None:
    found, older = inferred(np.zeros(160, dtype=bool))
    assert (found == older).all()


def test_nothing_is_inferred_of_a_sound_line() -> None:
    assert not inferred(np.ones(160, dtype=bool))[0].any()


def test_nothing_is_inferred_where_one_side_shows_ink() -> None:
    ways, _ = line()
    found, _ = inferred(ways.along < 4.05)
    assert not found[ways.along < 4.3].any()
    assert found[ways.along > 4.5].any()


def test_wide_older_ink_is_left_out() -> None:
    ways, older = line()
    older |= (ways.along > 3.0) & (ways.along < 3.8)
    why = np.where(older, int(Unseen.OLD_INK), int(Unseen.SEEN))
    found = infer_missing(np.zeros(len(ways)), ~older, why, ways, 1.0)
    assert not found[(ways.along > 3.0) & (ways.along < 3.8)].any()
    assert found[ways.along < 2.4].any()


@pytest.mark.parametrize(
    ("bath", "on_old", "contradicted"),
    [(1.0, 1.0, False), (0.0, 0.0, False), (0.0, 1.0, True), (1.0, 0.0, True), (0.5, 0.0, False)],
)
def test_older_ink_that_tells_otherwise_than_the_bath_is_doubted(
    bath: float, on_old: float, contradicted: bool
) -> None:
    ways, older = line()
    levels: list[FloatArray] = [np.full(len(ways), level) for level in (on_old, bath)]
    assert is_contradicted(levels[0], older, levels[1], ~older, ways, 1.0) is contradicted


def test_a_few_gaps_on_older_ink_contradict_nothing() -> None:
    ways, older = line()
    on_old = np.where(ways.along < 1.0, 0.0, 1.0)
    assert not is_contradicted(on_old, older, np.ones(len(ways)), ~older, ways, 1.0)
