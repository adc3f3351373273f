"""Working grid and its filters, against plain NumPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from registration import options
from registration.options import RegistrationOptions, segmentation_options
from registration.segmentation.filters import (
    gaussian_weights,
    interpolate_coarse,
    normalise,
    smooth,
    times_level,
)
from registration.segmentation.working import bins
from tests.registration.files.readers.crafted import scan


def test_a_large_scan_is_averaged_to_what_memory_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(options, "MOST_WORKING_VOXELS", 60_000)
    volume = np.zeros((64, 128, 128), np.uint8)
    large = replace(
        scan(volume=volume), voxel_mm=(0.01, 0.02, 0.02), modality="oct", optical_depth=False
    )
    found = segmentation_options(large, RegistrationOptions(), 0.24)
    left = volume.size / np.prod(bins(large, found.working_voxel_mm))
    assert 20_000 < left <= 60_000


@pytest.mark.parametrize("sigma", [0.0, 0.8, 3.0])
def test_smoothing_is_the_gaussian_with_the_nearest_value_beyond_the_edge(sigma: float) -> None:
    values = np.random.default_rng(0).random((40, 21, 13), dtype=np.float32)
    weights = gaussian_weights(sigma)
    out = np.empty_like(values)
    smooth(values, out, (weights, weights, weights), 0.0)
    expected = values.astype(np.float64)
    for axis in range(3):
        expected = ndimage.correlate1d(expected, weights, axis, mode="nearest")
    np.testing.assert_allclose(out, expected, atol=1e-6)


@pytest.mark.parametrize("factor", [(1, 3, 3), (4, 2, 5), (20, 20, 20)])
def test_levels_are_taken_off_as_interpolated_at_each_voxel(factor: tuple[int, int, int]) -> None:
    rng = np.random.default_rng(1)
    values = rng.random((20, 21, 22), dtype=np.float32)
    coarse = [max(1, n // f) for n, f in zip(values.shape, factor, strict=True)]
    low, high = (rng.random(coarse, dtype=np.float32) + shift for shift in (0.0, 2.0))
    expected = np.empty_like(values)
    for place in np.ndindex(values.shape):
        floor, top = (interpolate_coarse(level, factor, *place) for level in (low, high))
        expected[place] = (values[place] - floor) / (top - floor)
    normalise(values, low, high, factor)
    np.testing.assert_allclose(values, expected, atol=2e-6)


def test_a_level_multiplies_each_voxel_as_interpolated_there() -> None:
    rng = np.random.default_rng(2)
    values = rng.random((20, 21, 22), dtype=np.float32)
    level = rng.random((5, 10, 7), dtype=np.float32)
    factor = (4, 2, 3)
    expected = np.empty_like(values)
    for place in np.ndindex(values.shape):
        expected[place] = values[place] * max(interpolate_coarse(level, factor, *place), 0.1)
    np.testing.assert_allclose(times_level(values, level, factor), expected, atol=2e-6)
