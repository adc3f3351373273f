"""Topology: Betti numbers, graphs and overlaps of known shapes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage.measure import euler_number as peer_euler

from design.network import VesselNetwork
from registration.measuring.topology import (
    Betti,
    betti_numbers,
    lay_grid,
    overlap,
    scanned_with,
)
from registration.measuring.topology.compare import euler_number
from tests.registration.phantom import BLOCK, IDENTITY, block
from tests.slower import examples


def torus(tube: float = 3.0) -> np.ndarray:
    z, y, x = np.meshgrid(*(np.arange(-16, 17),) * 3, indexing="ij")
    return np.hypot(np.hypot(x, y) - 10, z) < tube


def ball(radius: float) -> np.ndarray:
    z, y, x = np.meshgrid(*(np.arange(-16, 17),) * 3, indexing="ij")
    return np.sqrt(x**2 + y**2 + z**2) < radius


def test_betti_numbers_of_known_solids() -> None:
    assert betti_numbers(ball(9)) == Betti(1, 0, 0)
    assert betti_numbers(ball(9) & ~ball(5)) == Betti(1, 0, 1)
    assert betti_numbers(torus()) == Betti(1, 1, 0)
    assert betti_numbers(torus() | ball(3)) == Betti(2, 1, 0)
    assert betti_numbers(np.zeros((4, 4, 4), bool)) == Betti(0, 0, 0)
    assert betti_numbers(torus()).euler == 0


@settings(max_examples=examples(40), deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 0.9))
def test_euler_number_agrees_with_scikit_image(seed: int, share: float) -> None:
    voxels = np.random.default_rng(seed).random((6, 7, 5)) < share
    padded = np.pad(voxels, 1)
    assert euler_number(padded) == peer_euler(padded, connectivity=3)


def tube(radius: float, offset: float = 0.0) -> VesselNetwork:
    nodes = np.array([[0.0, 2.2 + offset, 1.3], [9.0, 2.2 + offset, 1.3]])
    return VesselNetwork.from_segments(
        nodes, np.array([[0, 1]]), np.array([radius]), np.zeros(1), np.zeros(1)
    )


def bounds() -> np.ndarray:
    return np.stack([np.zeros(3), BLOCK])


@pytest.mark.parametrize(("printed", "designed"), [(0.5, 0.5), (0.6, 0.5), (0.4, 0.5)])
def test_volume_ratio_of_scaled_cylinders(printed: float, designed: float) -> None:
    only = lambda points: np.hypot(points[..., 1] - 2.2, points[..., 2] - 1.3) - printed  # noqa: E731
    full = block(extra=only, filled=lambda p: -only(p))
    grid = lay_grid(tube(designed), full.field, IDENTITY, bounds(), 0.04, 0.5)
    found = overlap(grid, 0.2)
    assert found.volume_ratio == pytest.approx((printed / designed) ** 2, rel=0.02)
    small, large = sorted((printed, designed))
    dice = 2 * small**2 / (small**2 + large**2)
    assert found.dice == pytest.approx(dice, abs=0.015)
    assert found.designed_mm3 == pytest.approx(np.pi * designed**2 * 9, rel=0.02)


def test_dice_of_offset_cylinders() -> None:
    r, offset = 0.5, 0.2
    only = lambda points: np.hypot(points[..., 1] - 2.2, points[..., 2] - 1.3) - r  # noqa: E731
    full = block(extra=only, filled=lambda p: -only(p))
    grid = lay_grid(tube(r, offset), full.field, IDENTITY, bounds(), 0.04, 0.5)
    lens = 2 * r**2 * np.arccos(offset / (2 * r)) - offset / 2 * np.sqrt(4 * r**2 - offset**2)
    assert overlap(grid, 0.4).dice == pytest.approx(lens / (np.pi * r**2), abs=0.015)
    assert scanned_with(grid, full.field, IDENTITY).free.sum() == grid.free.sum()
