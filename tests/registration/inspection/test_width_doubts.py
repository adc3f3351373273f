"""Widths that shading edges, a camera's response and misfitting models make unsure."""

import cv2
import numpy as np
import pytest

from registration.devices.microscope.ink_absorption import shade_profile
from registration.inspection.ink.ink_image import ACROSS, Template
from registration.inspection.widths.widths import measure_widths

PX_MM, WIDTH = 0.013, 0.25


def measured(mean, otherwise=None, bright=False):
    """Ratio and relative common uncertainty of 60 places that look alike."""
    rng = np.random.default_rng(1)
    profiles = (mean + 0.01 * rng.standard_normal((60, len(mean)))).astype(np.float32)
    terms = np.stack([mean, 0 * ACROSS, 0 * ACROSS])
    other = None if otherwise is None else np.tile(otherwise, (60, 1)).astype(np.float32)
    found = measure_widths(
        profiles, np.full(60, WIDTH), np.repeat(np.arange(6), 10), np.ones(60, dtype=np.bool_),
        Template(terms, scale=1.0, filled=True), PX_MM, 0.01, is_light=True, otherwise=other,
        bright=bright,
    )  # fmt: skip
    return float(np.median(found.width_mm)) / WIDTH, found.common


def line(per_mm=8.0, blur_mm=0.015):
    return shade_profile(ACROSS * WIDTH, WIDTH, per_mm, blur_mm)


def spread_light(mean, share, sigma_mm):
    """A part of the light scattered into the bath."""
    step = float(ACROSS[1] - ACROSS[0]) * WIDTH
    wide = cv2.GaussianBlur(mean[None], (0, 0), sigma_mm / step, borderType=cv2.BORDER_CONSTANT)[0]
    return (1 - share) * mean + share * wide


def slopes(mean, by, at=0.5, wide=0.09):
    """Light on a line's flanks: darker than bath and ink by so much of the ink's level."""
    return mean + by * np.exp(-0.5 * ((np.abs(ACROSS) - at) / wide) ** 2)


@pytest.mark.parametrize("sigma_um", [30, 60, 120])
@pytest.mark.parametrize("share", [0.2, 0.4, 0.8])
@pytest.mark.parametrize("per_mm", [2.0, 8.0, 40.0])
def test_a_halo_stays_within_what_is_stated(sigma_um, share, per_mm):
    ratio, u = measured(spread_light(line(per_mm), share, sigma_um * 1e-3))
    assert abs(ratio - 1.0) < 2.5 * u + 0.02


@pytest.mark.parametrize("by", [-0.5, -0.3, 0.3, 0.6])
@pytest.mark.parametrize("halo", [0.0, 0.06])
def test_edges_that_shade_or_shine_are_told_as_unsure(by, halo):
    """A ring light's shade on a line's slopes made it look 130 % wide, to 3 %."""
    mean = line() if not halo else spread_light(line(), 0.8, halo)
    ratio, u = measured(slopes(mean, by))
    assert np.isnan(ratio) or abs(ratio - 1.0) < 2.5 * u + 0.02


def test_plain_lines_are_known_to_some_hundredths():
    ratio, u = measured(line())
    assert ratio == pytest.approx(1.0, abs=0.02)
    assert u < 0.06
