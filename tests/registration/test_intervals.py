"""Confidence intervals of an alignment, on surfaces with drawn errors."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from design.solids import block_solid
from registration.alignment.distance import ModelSurface
from registration.alignment.fit import Fit, FitFreedom, refine
from registration.alignment.intervals import (
    BLOCK_MM,
    PATCH_MM,
    Uncertainty,
    fit_errors,
    uncertainty,
)
from registration.alignment.uncertainty import ScanErrors

SIZE = np.array([8.0, 5.0, 3.0])
START = Fit(np.eye(3), np.zeros(3), np.ones(3), SIZE / 2)
# With z stretching too a block's scales and the offset can't be told apart.
FREE = FitFreedom((0, 1), offset=True)
NOISE_MM = 0.004
SURE = ScanErrors.of_blur(0.0)


@cache
def model_surface():
    return ModelSurface.of(block_solid(SIZE.tolist()))


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


def sure_of(
    points: np.ndarray, fit: Fit, shared: ScanErrors, freedom: FitFreedom = FREE
) -> Uncertainty:
    return uncertainty(
        fit_errors(model_surface(), points, fit, freedom, shared), fit, freedom, shared
    )


def errors(fit: Fit) -> np.ndarray:
    middle = fit.rotation @ fit.centre + fit.shift - fit.centre
    return np.array([*middle, *(fit.scale[:2] - 1), fit.offset_mm])


@pytest.mark.slow
def test_intervals_cover_errors_that_whole_patches_share() -> None:
    rng = np.random.default_rng(0)
    covered, widths, found = [], [], []
    for _ in range(60):
        points, normals = faces(rng, 3000)
        cell = np.floor(points / PATCH_MM).astype(int) @ np.array([1, 20, 400])
        shared = rng.normal(0, NOISE_MM, cell.max() + 1)[cell]
        scan = points + shared[:, None] * normals
        fit = refine(model_surface(), scan, START, FREE)
        sure = sure_of(scan, fit, SURE)
        half = np.array([*sure.shift_mm, *sure.scale[:2], sure.offset_mm])
        covered.append(np.abs(errors(fit)) <= half)
        widths.append(half)
        found.append(errors(fit))
    assert 0.88 < np.mean(covered) < 0.99
    ratio = np.mean(widths, axis=0) / np.std(found, axis=0)
    np.testing.assert_allclose(ratio, 1.96, rtol=0.4)


def test_intervals_cover_what_whole_blocks_share() -> None:
    rng = np.random.default_rng(3)
    covered = []
    for _ in range(40):
        points, normals = faces(rng, 3000)
        cell = np.floor(points / BLOCK_MM).astype(int) @ np.array([1, 20, 400])
        side = (normals @ np.array([1, 2, 3])).astype(int) + 3
        shared = rng.normal(0, NOISE_MM, (7, cell.max() + 1))[side, cell]
        scan = points + shared[:, None] * normals
        fit = refine(model_surface(), scan, START, FREE)
        sure = sure_of(scan, fit, SURE)
        half = np.array([*sure.shift_mm, *sure.scale[:2], sure.offset_mm])
        covered.append(np.abs(errors(fit)) <= half)
    assert 0.88 < np.mean(covered) < 0.99
