"""A layer's shift is believed where its ink shows it."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from printctl.observe.looking_at import seen_where_ink_shows
from registration.layer_images import SeeingOptions


@pytest.mark.parametrize(
    ("shift_mm", "coverage", "searched_mm"),
    [
        (0.05, 0.95, [0.5]),
        (0.05, 0.1, [0.5, 0.1]),
        (0.3, 0.95, [0.5]),
        (0.3, 0.16, [0.5, 0.1]),
        (0.3, float("nan"), [0.5, 0.1]),
    ],
)
def test_a_layer_that_little_ink_shows_is_looked_at_again_within_tolerance(
    shift_mm, coverage, searched_mm
):
    searched = []

    def see(options):
        searched.append(options.shift_mm)
        shift = SimpleNamespace(dx_mm=0.0, dy_mm=min(shift_mm, options.shift_mm))
        return SimpleNamespace(shift=shift, coverage=coverage)

    found = seen_where_ink_shows(see, SeeingOptions(shift_mm=0.5), 0.1)
    assert searched == searched_mm
    assert found.shift.dy_mm == min(shift_mm, searched_mm[-1])
