"""Half-level shift by speckle and clipping, against random draws."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, gaussian_filter1d
from scipy.special import ndtr

from registration.segmentation.speckle_cap import (
    edge_of,
    looks_of,
    speckle_shift,
    two_caps_shift,
)
from tests.slower import first_rows

FloatArray = NDArray[np.float64]
HALF = 20


def walls(edge: float, looks: float, many: int, seed: int) -> FloatArray:
    """Speckle of A-scans across a wall at a random place within the middle voxel, (many, n)."""
    rng = np.random.default_rng(seed)
    place = np.arange(-HALF, HALF + 1) + rng.uniform(-0.5, 0.5, (many, 1))
    share = np.mean([ndtr((place + u) / edge) for u in np.linspace(-0.5, 0.5, 21)], axis=0)
    return np.asarray(share * rng.gamma(looks, 1 / looks, share.shape)), place


def crossing(profile: FloatArray, place: FloatArray) -> float:
    """Where the mean over A-scans meets half of its end."""
    bins = np.round(place * 10).astype(int)
    low = bins.min()
    total = np.bincount((bins - low).ravel(), profile.ravel())
    mean = total / np.maximum(np.bincount((bins - low).ravel()), 1)
    x = (np.arange(len(mean)) + low) / 10
    inner = np.abs(x) < 3
    level = mean[(x > 8) & (x < 12)].mean() / 2
    return float(np.interp(level, gaussian_filter1d(mean, 2)[inner], x[inner]))


@pytest.mark.parametrize(("edge", "looks"), first_rows([(0.5, 1.9), (0.5, 1.0), (0.2, 1.9)]))
def test_walls_come_out_in_the_liquid_as_far_as_drawn_speckle_puts_them(edge: float, looks: float):
    caps, soft = (1.5, 1.15), (0.6, 0.8)
    speckle, place = walls(edge, looks, 60_000, 1)
    once = gaussian_filter1d(np.minimum(speckle, caps[0]), soft[0], axis=1)
    gel = once[:, HALF + 6 : -4]
    some = float(gel.mean() ** 2 / gel.var())
    twice = gaussian_filter1d(np.minimum(once, caps[1]), soft[1], axis=1)
    drawn = -crossing(twice, place)
    assert two_caps_shift(edge, soft, (looks, some), caps) == pytest.approx(drawn, rel=0.12)
    assert drawn > 0.03


def test_speckle_alone_puts_walls_into_the_gel():
    blur, looks = 2.0, 20.0
    rng = np.random.default_rng(2)
    x = np.arange(-30, 31)
    field = (x > 0) + 0.5 * (x == 0)
    drawn = gaussian_filter1d(field * rng.gamma(looks, 1 / looks, (40_000, len(x))), blur, axis=1)
    variance = 1 / looks / (2 * np.sqrt(np.pi) * blur)
    above = drawn[:, 20:40] >= 0.5
    first = above.argmax(axis=1)
    low, high = (drawn[np.arange(len(drawn)), 20 + first + k] for k in (-1, 0))
    met = x[20] + first - 1 + (0.5 - low) / (high - low)
    assert met.mean() == pytest.approx(speckle_shift(blur, variance**-0.5), rel=0.25)


def test_looks_and_point_spread_are_told_by_speckle():
    rng = np.random.default_rng(3)
    spread = 0.8
    total = np.zeros((40, 60, 80))
    for _ in range(4):  # two looks, of two quadratures each
        total += gaussian_filter(rng.standard_normal(total.shape), spread) ** 2
    speckle = (total / total.mean()).astype(np.float32)
    gel = np.ones(speckle.shape, np.bool_)
    assert looks_of(speckle, gel) == pytest.approx(2.0, rel=0.1)
    for axis in (0, 2):
        assert edge_of(speckle, gel, axis) == pytest.approx(spread / np.sqrt(2), rel=0.1)


def test_of_little_gel_nothing_is_told():
    gel = np.zeros((8, 8, 8), np.bool_)
    assert looks_of(np.ones(gel.shape, np.float32), gel) == 1.0
    assert edge_of(np.ones(gel.shape, np.float32), gel, 2) < 0.25
