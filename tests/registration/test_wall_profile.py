"""Walls of lumens are placed by the mean light across them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
import pytest
from scipy.special import ndtr

from registration.measuring.gauging.wall_profile import wall_profile
from registration.segmentation import Segmentation
from registration.segmentation.volume import Strength
from tests.registration.phantom import as_designed, block, traces

SPREAD, PLACE = 0.015, 0.008


@cache
def scan(
    line_mm: float, speckle: Literal["one look", "heavy tails"] = "one look", level: bool = False
) -> Segmentation:
    """The block, its walls with a line of so much gel; `level`: only those that face the light."""
    found = block(as_designed)
    u = (0.3 * (found.field.values.astype(float) - 0.5) - PLACE) / SPREAD
    slope = np.exp(-u * u / 2) / (np.sqrt(2 * np.pi) * SPREAD)
    if level:
        z, y, x = np.gradient(u)
        slope *= np.abs(z) > 0.75 * np.sqrt(x * x + y * y + z * z)
    rng = np.random.default_rng(5)
    light = (ndtr(u) + line_mm * slope) * rng.exponential(size=u.shape)
    if speckle == "heavy tails":
        light *= rng.gamma(1.0, size=u.shape)
    strength = Strength(light.astype(np.float32), 0.01, light.astype(np.float16))
    return replace(found, strength=strength, field=replace(found.field, faint_mm=0.006))


@pytest.mark.parametrize("speckle", ["one look", "heavy tails"])
def test_walls_are_found_whatever_the_law_of_speckle(speckle: Literal["one look", "heavy tails"]):
    found = wall_profile(traces(scan(0.0, speckle)), scan(0.0, speckle))
    assert found is not None
    assert found.place_mm == pytest.approx(PLACE, abs=0.002)
    assert found.error_mm < 0.002
    assert found.line_mm[0] < 0.002
