"""Tip travel to a job's start, and its description in the set-up."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printctl.web.job.machine import Machine, mounted_checks, set_up_of
from printctl.web.job.set_up import JobSetUp
from printctl.web.job.to_start import places_to

PLACE = st.tuples(*[st.floats(0, 200)] * 3)


@given(PLACE, PLACE, st.none() | st.floats(0, 200))
def test_the_tip_goes_aside_only_above_all_that_is_known(tip, start, over):
    places = places_to(tip, start, over)
    assert places[-1] == start
    for before, after in zip([tip, *places], places, strict=False):
        if before[:2] != after[:2]:
            assert before[2] == after[2] >= max(tip[2], start[2], over or 0.0)


def test_a_job_that_declares_its_start_keeps_it_wherever_the_tip_stands():
    machine = Machine("generic_marlin", "simulated", tip_mm=(30.0, 30.0, 30.0))
    assert set_up_of(machine, JobSetUp(), (100.0, 100.0, 9.0)).start_mm == (100.0, 100.0, 9.0)
    assert set_up_of(machine, JobSetUp()).start_mm == (30.0, 30.0, 30.0)


@pytest.mark.parametrize("due", [True, False])
def test_a_needle_that_wasnt_touched_off_refuses_the_print(due):
    tip = JobSetUp().start_mm
    machine = Machine("generic_marlin", "simulated", tip_mm=tip, touch_off_due=due)
    said = JobSetUp().model_copy(update={"printer": "generic_marlin"})
    found = [check.check for check in mounted_checks(machine, said, 1.0) if check.refuses]
    assert found == (["needle's touch-off"] if due else [])
