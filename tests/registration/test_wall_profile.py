"""Mean surface of rough reflecting walls, from the mean profile across them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.special import ndtr

from registration.gauging.wall_profile import WallProfile, wall_profile
from registration.gauging.wall_reflections import FACING_PRIOR_MM, with_ledges
from registration.segmentation import Segmentation
from registration.segmentation.volume import Strength
from registration.uncertainty import ScanErrors
from tests.registration.phantom import as_designed, block, traces
from tests.slower import first_of

LEVEL, LIQUID, OPTICS = 7.0, 0.05, 0.012
"""Gel's brightness, the liquid's over that, the point spread's standard deviation, mm."""
SPREAD, PLACE = 0.03, 0.008
"""Of the walls' heights (Gaussian as is fitted, or uniform), and how much further they lie
in the gel than the field has them, mm."""


@cache
def shining(line_mm: float, uniform: bool = True, across_light: bool = False) -> Segmentation:
    """The block with speckle, walls rough by `SPREAD`, and a bright line of so much gel.

    `across_light`: where walls face the light or away from it alone.
    """
    found = block(as_designed)
    depth = 0.3 * (found.field.values.astype(float) - 0.5) - PLACE
    heights = np.sqrt(3) * np.linspace(-1, 1, 9) if uniform else np.zeros(1)
    sharp = OPTICS if uniform else float(np.hypot(OPTICS, SPREAD))
    u = [(depth - SPREAD * height) / sharp for height in heights]
    gel = np.mean([ndtr(one) for one in u], axis=0)
    slope = np.mean([np.exp(-one * one / 2) for one in u], axis=0) / (np.sqrt(2 * np.pi) * sharp)
    if across_light:
        z, y, x = np.gradient(depth)
        slope *= np.abs(z) > 0.75 * np.sqrt(x * x + y * y + z * z)
    mean = LIQUID + (1 - LIQUID) * (gel + line_mm * slope)
    speckle = np.random.default_rng(5).exponential(size=mean.shape)
    signal = (LEVEL * mean * speckle).astype(np.float32)
    return replace(found, strength=Strength(signal, 0.01, LIQUID))


def profile(line_mm: float, uniform: bool = True) -> WallProfile | None:
    scan = shining(line_mm, uniform)
    return wall_profile(traces(scan), scan)


@pytest.mark.slow
@pytest.mark.parametrize("line_mm", first_of([0.4, 0.1]))
@pytest.mark.parametrize("uniform", first_of([True, False]))
def test_the_mean_surface_is_found_under_a_bright_line(line_mm: float, uniform: bool):
    found = profile(line_mm, uniform)
    assert found is not None
    assert found.told
    assert found.place_mm == pytest.approx(PLACE, abs=max(2.5 * found.error_mm, 0.002))
    assert found.error_mm < 0.003
    assert found.line_mm == pytest.approx(line_mm, rel=0.25)


@pytest.mark.parametrize("line_mm", first_of([0.012, 0.0]))
def test_a_line_fainter_than_the_walls_are_rough_is_not_told(line_mm: float):
    found = profile(line_mm)
    assert found is None or not found.told


def test_a_line_told_moves_sections_and_has_its_own_error():
    scan = shining(0.4)
    field = replace(scan.field, faint_mm=0.006)
    before = tuple(
        replace(one, sections=replace(one.sections, noise=np.full(len(one.along), 0.05)))
        for one in traces(scan)
    )
    errors = replace(ScanErrors.of_blur(0.04), faint_mm=0.0045, facing_mm=0.004, cut_mm=0.001)
    rough = replace(scan, field=field)
    moved, left, wall = with_ledges(before, rough, errors)
    dull, kept, usual = with_ledges(before, replace(rough, strength=None), errors)
    assert (left.faint_mm, left.facing_mm, left.cut_mm) == (0.0, 0.0, 0.0)
    assert 0 < left.line_mm < kept.faint_mm
    assert kept.line_mm == 0.0
    for one, other in zip(moved, dull, strict=True):
        known = other.sections.diameter > 0
        change = one.sections.diameter[known] - other.sections.diameter[known]
        np.testing.assert_allclose(change, 2 * (wall - usual))


@pytest.mark.slow
def test_walls_that_shine_across_the_light_alone_move_by_profile_and_prior():
    scan = shining(0.2, across_light=True)
    rough = replace(scan, field=replace(scan.field, faint_mm=0.003))
    before = traces(scan)
    errors = replace(ScanErrors.of_blur(0.04), faint_mm=0.0001, facing_mm=0.001)
    moved, left, _ = with_ledges(before, rough, errors)
    dull, _, _ = with_ledges(before, replace(rough, strength=None), errors)
    found = wall_profile(dull, rough, across_light=True)
    assert found is not None
    place, error = found.expected(FACING_PRIOR_MM)
    assert left.faint_mm <= errors.faint_mm
    assert left.facing_mm == pytest.approx(error / 0.818, rel=0.01)
    _, calibrated, _ = with_ledges(before, rough, replace(errors, facing_mm=0.0))
    assert calibrated.facing_mm == 0.0
    for one, other in zip(moved, dull, strict=True):
        known = other.sections.diameter > 0
        change = one.sections.diameter[known] - other.sections.diameter[known]
        np.testing.assert_allclose(change, place / 0.818, rtol=0.02)


def test_without_light_there_is_no_profile():
    scan = replace(shining(0.4), strength=None)
    assert wall_profile(traces(scan), scan) is None


@pytest.mark.parametrize(
    ("line_mm", "place_mm", "expected_mm", "u_mm"),
    [
        (0.017, 0.014, 0.0048, 0.0020),  # a line as thin as the wall's own width: the prior's
        (0.150, -0.001, -0.0002, 0.0015),  # a bright one: the profile's, also where it
        (0.036, 0.019, 0.0183, 0.0041),  # lies far from what the prior expects
    ],
)
def test_a_profile_counts_as_far_as_its_line_tells(
    line_mm: float, place_mm: float, expected_mm: float, u_mm: float
):
    error = 0.0018 if line_mm > 0.1 else 0.004
    found = WallProfile(place_mm, error, 0.017 if line_mm < 0.02 else 0.011, line_mm, 0.001)
    place, u = found.expected((0.0045, 0.002))
    assert place == pytest.approx(expected_mm, abs=0.0015)
    assert u == pytest.approx(u_mm, abs=0.0006)
