"""Walls of lumens are placed by the mean light across them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
import pytest
from scipy.special import ndtr

from registration.alignment.uncertainty import ScanErrors
from registration.measuring.gauging.wall_profile import wall_profile, with_told_walls
from registration.segmentation import Segmentation
from registration.segmentation.volume import Strength
from registration.wall_reference import WallCalibration
from tests.registration.phantom import as_designed, block, traces

SPREAD, PLACE = 0.015, 0.008
"""Of the point spread, and how much further walls lie in the gel than the field has them, mm."""


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


def test_sections_move_and_a_reference_moves_them_on_and_leaves_the_profiles_own_error():
    dull = scan(0.0)
    before = traces(dull)
    errors = replace(ScanErrors.of_blur(0.04), faint_mm=0.0045, facing_mm=0.004)
    moved, left, wall = with_told_walls(before, dull, errors)
    assert (left.faint_mm, left.facing_mm) == (0.0, 0.0)
    assert wall - dull.field.wall_mm == pytest.approx(PLACE, abs=0.003)
    for one, other in zip(moved, before, strict=True):
        known = other.sections.diameter > 0
        change = one.sections.diameter[known] - other.sections.diameter[known]
        np.testing.assert_allclose(change, 2 * (wall - dull.field.wall_mm))
        np.testing.assert_array_equal(
            one.sections.diameter[~known], other.sections.diameter[~known]
        )
    profile = wall_profile(before, dull)
    assert profile is not None
    for scans, chance in ((3, profile.error_mm), (1, np.sqrt(2) * profile.error_mm)):
        reference = replace(errors, reference=WallCalibration(10.0, 1.0, 400.0, 600.0, scans))
        field = replace(dull.field, wall_mm=dull.field.wall_mm + 0.010)  # as `segment` does
        offset = replace(dull, field=field)
        further, known, place = with_told_walls(traces(offset), offset, reference)
        assert place == pytest.approx(wall + 0.010, abs=5e-4)
        assert known.line_mm == pytest.approx(chance, rel=0.1)
        assert known.line_mm < left.line_mm
        for one, other in zip(further, moved, strict=True):
            known_mm = other.sections.diameter > 0
            change = one.sections.diameter[known_mm] - other.sections.diameter[known_mm]
            np.testing.assert_allclose(change, 0.020, atol=1e-3)
