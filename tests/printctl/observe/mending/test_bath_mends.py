"""Mends of filaments in a bath."""

import numpy as np
import pytest

from printctl.observe.mending import Gap, Voids, check_mend, plan_mend
from tests.printctl.observe.mending.small_jobs import bath_job
from tests.slower import first_of

DEEP = [(100, 100, 5), (106, 100, 5.5), (112, 102, 5)]
ABOVE = [(103, 97, 8), (103, 103, 8)]


def test_a_break_is_written_again_from_above():
    held = bath_job(DEEP).held()
    gap = Gap(0, 4.0, 6.5)
    mend = plan_mend(held, [gap])
    checked = check_mend(held, mend.lines, [gap])
    assert (len(mend.patches), mend.left) == (1, ())
    assert checked.passed
    assert checked.covered == 1.0


def test_what_lies_under_another_filament_stays_and_the_rest_is_mended():
    held = bath_job(DEEP, ABOVE).held()
    gap = Gap(0, 1.0, 5.0)
    mend = plan_mend(held, [gap])
    assert "another filament" in mend.left[0].reason
    assert len(mend.patches) == 2
    assert check_mend(held, mend.lines, [gap]).passed
    assert mend.left[0].length_mm == pytest.approx(2 * (0.155 + 0.2), abs=0.35)


def test_a_check_sees_a_shaft_through_ink():
    gap = Gap(0, 1.0, 5.0)
    lower = bath_job(DEEP).held()
    insert = plan_mend(lower, [gap]).lines
    later = bath_job(DEEP, ABOVE).held()
    moved = [line for line in insert if not line.startswith(b"G92")]
    assert check_mend(later, moved, [gap]).ink_crossed > 0


def test_thin_filaments_are_left_to_the_flow():
    mend = plan_mend(bath_job(DEEP).held(), [Gap(0, 3.0, 4.0, missing=0.3)])
    assert not mend.lines
    assert "correct the flow" in mend.left[0].reason


def test_vessels_that_the_job_writes_are_no_voids_and_others_are():
    held, gap = bath_job(DEEP).held(), Gap(0, 4.0, 6.5)
    own = np.array(DEEP, dtype=float)
    across = np.array([[105.0, 90, 5.4], [105, 110, 5.4]])
    start, end = (np.vstack([own[k : k + 2], across[k]]) for k in (0, 1))
    voids = Voids(start, end, np.full((3, 2), 0.2))
    mend = plan_mend(held, [gap], voids)
    assert len(mend.patches) == 2
    assert ["lumen" in one.reason for one in mend.left] == [True]
    assert check_mend(held, mend.lines, [gap], voids).passed


@pytest.mark.parametrize("upwards", first_of([True, False]))
def test_a_needle_never_comes_down_through_the_upright_ink_that_it_mends(upwards):
    upright = [(100, 100, 4), (100, 100, 9)]
    held = bath_job(upright if upwards else upright[::-1]).held()  # held straight above it
    gap = Gap(0, 2.0, 2.5)
    mend = plan_mend(held, [gap])
    assert not mend.lines
    assert "same path" in mend.left[0].reason
