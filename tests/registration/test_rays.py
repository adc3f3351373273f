"""Rays cast across a lumen to its wall, against plain NumPy."""

from __future__ import annotations

import numpy as np

from registration.measuring.gauging.sections import first_walls
from registration.segmentation.volume import GelField


def naive(field, centre, across, shift, circle, along, step):
    """All samples of all rays, and the first rise through the level."""
    flat = shift[:, None, None] + circle[None, :, None] * along[:, None]
    places = centre[:, None, None] + np.einsum("nrkc,ncd->nrkd", flat, across)
    value = field.above_level(places)
    rises = (value[..., :-1] < 0) & (value[..., 1:] >= 0)
    out = np.full(rises.shape[:2], np.nan)
    for n, r in np.argwhere(rises.any(axis=2)):
        k = int(rises[n, r].argmax())
        low, high = value[n, r, k : k + 2]
        out[n, r] = along[k] + step * low / (low - high)
    return out


def test_rays_meet_the_wall_where_all_samples_say_it_is():
    rng = np.random.default_rng(1)
    field = GelField(
        rng.normal(size=(12, 14, 16)).astype(np.float32),
        0.2,
        -1.0,
        np.array([0.02, 0.03, 0.01]),
        np.array([0.01, 0.0, -0.02]),
        0.0,
    )
    middle = field.origin_mm + field.voxel_mm * np.array([8, 7, 6])
    centre = middle + 0.02 * rng.normal(size=(30, 3))
    across = np.stack([np.linalg.qr(rng.normal(size=(3, 3)))[0][:2] for _ in centre])
    shift = 0.01 * rng.normal(size=(30, 2))
    angle = 2 * np.pi * np.arange(10) / 10
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    along = np.arange(0.0, 0.4, 0.004)  # beyond the field, too
    grid = (field.values, field.sign, field.level, field.origin_mm, field.voxel_mm)
    found = first_walls(*grid, centre, across, shift, circle, along, 0.004)
    expected = naive(field, centre, across, shift, circle, along, 0.004)
    assert 0 < np.isnan(expected).sum() < expected.size
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
