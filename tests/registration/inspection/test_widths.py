"""Widths of lines that differ in width."""

import numpy as np
import pytest

from registration.devices.microscope.ink_absorption import shade_profile
from registration.inspection.ink.ink_image import ACROSS, Template
from registration.inspection.widths.widths import measure_widths

PX_MM = 0.02


def test_two_lines_of_unlike_widths_with_as_many_places_each_are_measured() -> None:
    """Their median is neither's width: nothing was alike, and the observer failed."""
    true = np.repeat([0.3, 0.6], 8)
    profiles = np.stack([shade_profile(ACROSS * one, one, 4.0, 0.02) for one in true])
    terms = np.stack([profiles[0], 0 * ACROSS, 0 * ACROSS])
    found = measure_widths(
        profiles.astype(np.float32), true, np.repeat([0, 1], 8), np.ones(16, dtype=np.bool_),
        Template(terms, scale=1.0, filled=True), PX_MM, noise=0.02, is_light=True,
    )  # fmt: skip
    assert found.width_mm == pytest.approx(true, rel=0.06)
