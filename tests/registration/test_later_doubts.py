"""Pose doubts known only after the fit."""

from __future__ import annotations

import pytest

from registration.alignment import later_doubts


def test_two_programs_that_agree_in_good_light_raise_no_doubt():
    assert later_doubts(11.0, 0.54) == ()
    assert later_doubts(None, 1.0) == ()


@pytest.mark.parametrize(
    ("cross_um", "seen", "said"),
    [(29.0, 0.9, "29 µm from ours (limit 20 µm)"), (5.0, 0.37, "37 % of the scanned surface")],
)
def test_a_clean_part_at_low_contrast_was_failed_by_walls_that_were_not_there(cross_um, seen, said):
    (doubt,) = later_doubts(cross_um, seen)
    assert said in doubt
