"""Cross-section models of printed lines: width from area, and back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from firmware_profiles import Ink, load
from firmware_profiles.bead import BeadSection

MODELS = ("rounded", "rectangle", "ellipse", 12.5)


@pytest.mark.parametrize("model", MODELS)
@given(area=st.floats(1e-6, 2.0), height=st.floats(0.01, 0.5))
def test_area_is_the_inverse_of_width(model, area, height):
    bead = BeadSection(model)
    assert bead.area(bead.width(np.array([area]), height), height) == pytest.approx(area)


def test_a_rounded_line_is_a_band_between_half_circles_and_round_where_it_is_small():
    height = 0.06
    band = (0.15 - height) * height + math.pi / 4 * height**2
    small = math.pi / 4 * 0.03**2
    found = BeadSection().width(np.array([band, small]), height)
    assert found == pytest.approx([0.15, 0.03])


def test_an_ink_is_rounded_where_it_doesn_t_say_otherwise():
    facts = load(Ink, "collagen_fresh").model_dump()
    assert Ink.model_validate(facts).bead_section == BeadSection("rounded")
    assert Ink.model_validate(facts | {"bead": 8.0}).bead_section == BeadSection(8.0)
    for wrong in ("square", -3.0, math.inf):
        with pytest.raises(ValidationError):
            Ink.model_validate(facts | {"bead": wrong})
