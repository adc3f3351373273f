"""Intervals of a fit, on surfaces whose errors are drawn."""

from __future__ import annotations

import numpy as np

from design.solids import block_solid
from registration.alignment.fit import Fit, Freedom, refine
from registration.alignment.intervals import ALONG_LIGHT, OWN, PATCH_MM, uncertainty
from registration.distance import ModelSurface

SIZE = np.array([8.0, 5.0, 3.0])
MODEL = ModelSurface.of(block_solid(SIZE.tolist()))
START = Fit(np.eye(3), np.zeros(3), np.ones(3), SIZE / 2)
# With z stretching too a block's scales and the offset can't be told apart.
FREE = Freedom((0, 1), offset=True)
NOISE_MM = 0.004


def faces(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points on the block's six faces, and their normals."""
    axis = rng.integers(3, size=count)
    high = rng.integers(2, size=count)
    points = rng.uniform(0.2, 1, (count, 3)) * (SIZE - 0.2)
    rows = np.arange(count)
    points[rows, axis] = high * SIZE[axis]
    normals = np.zeros((count, 3))
    normals[rows, axis] = 2 * high - 1
    return points, normals


def errors(fit: Fit) -> np.ndarray:
    middle = fit.rotation @ fit.centre + fit.shift - fit.centre
    return np.array([*middle, *(fit.scale[:2] - 1), fit.offset_mm])


def test_intervals_cover_errors_that_whole_patches_share() -> None:
    rng = np.random.default_rng(0)
    covered, widths, found = [], [], []
    for _ in range(60):
        points, normals = faces(rng, 3000)
        cell = np.floor(points / PATCH_MM).astype(int) @ np.array([1, 20, 400])
        shared = rng.normal(0, NOISE_MM, cell.max() + 1)[cell]
        scan = points + shared[:, None] * normals
        fit = refine(MODEL, scan, START, FREE)
        sure = uncertainty(MODEL, scan, fit, FREE, 0.0)
        half = np.array([*sure.shift_mm, *sure.scale[:2], sure.offset_mm])
        covered.append(np.abs(errors(fit)) <= half)
        widths.append(half)
        found.append(errors(fit))
    assert 0.88 < np.mean(covered) < 0.99
    ratio = np.mean(widths, axis=0) / np.std(found, axis=0)
    np.testing.assert_allclose(ratio, 1.96, rtol=0.4)


def test_what_every_scan_shares_widens_them_by_the_blur() -> None:
    points, _ = faces(np.random.default_rng(1), 3000)
    sharp = uncertainty(MODEL, points, START, FREE, 0.0)
    blurred = uncertainty(MODEL, points, START, FREE, 0.05)
    assert sharp.shift_mm.max() < 1e-6
    # Two opposite faces, each off by its own share, and along the light all by the same.
    expected = 1.96 * 0.05 * np.array([OWN**2 / 2, OWN**2 / 2, OWN**2 / 2 + ALONG_LIGHT**2]) ** 0.5
    np.testing.assert_allclose(blurred.shift_mm, expected, rtol=0.1)


def test_what_was_not_fitted_has_no_interval() -> None:
    points, _ = faces(np.random.default_rng(1), 1000)
    sure = uncertainty(MODEL, points, START, Freedom((0, 1)), 0.02)
    assert np.isnan(sure.scale).tolist() == [False, False, True]
    assert np.isnan(sure.offset_mm)
