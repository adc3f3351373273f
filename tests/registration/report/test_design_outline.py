"""Excess of printed lines over the design's outline."""

import numpy as np
import pytest

from registration.report.gcode import design_outline, draw_layer
from registration.report.gcode.colouring import colourings
from registration.report.gcode.part_outline import REACH_MM

from .gcode_sample import layered_job

BOX = np.array([[0.0, 0.7], [10, 0.7], [10, 2.3], [0, 2.3]])
"""Around the lines at y = 1 and 2, which are 0.5 mm wide."""


def test_ink_beyond_the_outline_counts_above_nought_and_short_of_it_below() -> None:
    shifted = BOX + [0.0, 0.1]
    found = design_outline(layered_job(), 0, [shifted])
    (ring,), (beyond,) = found.rings, found.beyond_mm
    middle = 0.5 * (ring[1:] + ring[:-1])
    inner = (middle[:, 0] > 0.5) & (middle[:, 0] < 9.5)
    assert beyond[inner & (middle[:, 1] < 1)] == pytest.approx(0.05)
    assert beyond[inner & (middle[:, 1] > 2)] == pytest.approx(-0.15)
    assert np.linalg.norm(np.diff(ring, axis=0), axis=1).max() < 0.0301


def test_an_outline_without_ink_near_is_as_short_as_can_be() -> None:
    found = design_outline(layered_job(), 1, [BOX + [0.0, 30.0]])
    assert (found.beyond_mm[0] == -REACH_MM).all()


def test_the_picture_shows_where_ink_is_missing() -> None:
    job = layered_job()
    colouring = colourings(job)[0]
    plain = draw_layer(job, 0, colouring, 400, False)
    near = draw_layer(job, 0, colouring, 400, False, design_outline(job, 0, [BOX]))
    off = draw_layer(job, 0, colouring, 400, False, design_outline(job, 0, [BOX + [0.0, 0.1]]))
    assert len({plain, near, off}) == 3
