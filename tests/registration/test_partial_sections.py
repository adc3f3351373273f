"""Sections of which only part of the wall is a vessel's own: diameters and their intervals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from registration.measuring.gauging.sections import (
    RAYS,
    Planes,
    Sections,
    cut_sections,
    partial_noise,
)
from registration.segmentation.volume import GelField

RADIUS, BLUR = 0.15, 0.02


def sections(met: float, scatter: float, seed: int, count: int = 400) -> Sections:
    """Lumens of `RADIUS`, of whose rays the others look into a neighbour and aren't met."""
    random = np.random.default_rng(seed)
    rays = RADIUS + scatter * random.standard_normal((count, RAYS))
    rays[:, round(met * RAYS) :] = np.nan
    share = np.isfinite(rays).mean(axis=1)
    nothing = np.full(count, np.nan)
    median = 2 * np.nanmedian(rays, axis=1)
    yes, no = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
    return Sections(
        yes, no, nothing, median, share, nothing, np.zeros((count, 2)), rays, nothing, nothing
    )


@pytest.mark.parametrize("met", [0.6, 0.75, 0.9])
@pytest.mark.parametrize("scatter", [0.002, 0.004])
def test_the_interval_holds_the_diameter(met, scatter):
    found = sections(met, scatter, seed=3)
    noise = partial_noise(found, BLUR)
    inside = np.abs(found.median - 2 * RADIUS) < 1.96 * noise
    assert inside.mean() > 0.95
    # It isn't so wide that it says nothing.
    assert np.median(noise) < 4 * scatter + 0.6 * BLUR


VOXEL = 0.005


def beside(ways: list[float], gap: float, blur: float) -> tuple[Sections, float]:
    """Section of a lumen of `RADIUS` with lumens as wide in these directions (radians), blurred.

    Gel of `gap` mm is between; returns the section and the standard error of its median.
    """
    half = 4 * RADIUS + 4 * blur
    y, x = np.mgrid[-half : half + VOXEL / 2 : VOXEL, -half : half + VOXEL / 2 : VOXEL]
    wall = np.hypot(x, y) - RADIUS
    for way in ways:
        off = 2 * RADIUS + gap
        other = np.hypot(x - off * np.cos(way), y - off * np.sin(way)) - RADIUS
        wall = np.minimum(wall, other)
    gel = gaussian_filter(np.clip(wall / VOXEL + 0.5, 0.0, 1.0), blur / VOXEL)
    values = np.repeat(gel[None].astype(np.float32), 3, axis=0)
    field = GelField(
        values, 0.5, 1.0, np.full(3, VOXEL), np.array([-half, -half, -VOXEL]), blur_mm=blur
    )
    found = cut_sections(field, Planes(np.zeros((1, 3)), np.eye(3)[None, :2], np.full(1, RADIUS)))
    return found, float(partial_noise(found, blur)[0])


@pytest.mark.parametrize(
    "ways", [[0.0], [0.0, np.pi], [0.3, 1.5], [0.0, np.pi / 3, 2 * np.pi / 3, np.pi]]
)
@pytest.mark.parametrize("gap", [0.2, 0.6, 1.0])
@pytest.mark.parametrize("blur", [0.2, 0.35, 0.5])
def test_gel_thinner_than_the_blur_is_in_the_interval(ways, gap, blur):
    sigma = blur * RADIUS
    found, noise = beside(ways, gap * sigma, sigma)
    assert found.open.all()
    if found.closed_outline[0] or np.isnan(noise):
        return
    assert abs(found.median[0] - 2 * RADIUS) < 1.96 * noise
