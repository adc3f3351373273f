"""Gel share at inclined walls, against single-ray tracing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.segmentation.walls import Sides, scatter_of_liquid, share_of_volume
from registration.segmentation.working import Working

VOXEL = 0.03
SHAPE = (60, 8, 60)
RAYS = 400
GEL, LIQUID = 0.7, 0.035  # 1/mm


@dataclass
class Traced:
    """A block's side wall, lit from above: what comes back, the light there, the share of gel."""

    signal: NDArray[np.float32]
    light: NDArray[np.float32]
    share: FloatArray


def traced(lean: float) -> Traced:
    """Gel left of a wall that stands at the middle at half depth, and leans by a slope."""
    nz, ny, nx = SHAPE
    x = (np.arange(nx * RAYS) + 0.5) / RAYS * VOXEL
    beam = np.ones(len(x))
    back, light, share = (np.empty((nz, nx)) for _ in range(3))
    for z in range(nz):
        wall = 0.5 * nx * VOXEL + lean * (z + 0.5 - 0.5 * nz) * VOXEL
        gel = x < wall
        mu = np.where(gel, GEL, LIQUID)
        beam *= np.exp(-mu * VOXEL)  # there and back, to the voxel's middle
        for out, ray in ((back, mu * beam), (light, GEL * beam), (share, gel)):
            out[z] = ray.reshape(nx, RAYS).mean(axis=1)
        beam *= np.exp(-mu * VOXEL)
    signal, light = (np.repeat(a[:, None], ny, axis=1).astype(np.float32) for a in (back, light))
    return Traced(signal, light, np.repeat(share[:, None], ny, axis=1))


def sides(share: FloatArray) -> Sides:
    """More than two voxels from the wall at every depth."""
    wide = np.stack([np.roll(share, k, axis=2) for k in range(-2, 3)])
    return Sides(wide.min(axis=0) == 1.0, wide.max(axis=0) == 0.0)


def working() -> Working:
    return Working((1, 1, 1), np.ones(3), np.full(3, VOXEL), np.zeros(3), VOXEL)


# The wall faces the light where gel widens on the way down.
@pytest.mark.parametrize("lean", [0.03, 0.01, 0.0, -0.01, -0.03])
def test_wall_that_leans_has_its_share_of_gel(lean):
    truth = traced(lean)
    found, known = share_of_volume(
        truth.signal, truth.light, sides(truth.share), working(), (1, 3, 3)
    )
    inside = np.s_[8:-8, :, 24:-24]
    assert known[inside].all()
    # Summed across the wall it is the wall's place, in voxels.
    off = (found - truth.share)[inside].sum(axis=2)
    assert np.abs(off).max() < 0.06
    beside = truth.light[inside][..., :1]
    naive = (truth.signal[inside] / beside - truth.share[inside]).sum(axis=2)
    if lean:
        assert np.abs(naive).max() > 0.2


def test_scatter_of_liquid_is_told_from_where_light_is_strong():
    truth = traced(0.0)
    far = sides(truth.share)
    assert scatter_of_liquid(truth.signal, truth.light, far.liquid) == pytest.approx(
        LIQUID / GEL, rel=1e-3
    )
    nowhere = np.zeros(SHAPE, dtype=bool)
    assert scatter_of_liquid(truth.signal, truth.light, nowhere) == 0.0


def test_where_nothing_is_beside_there_is_no_gel():
    truth = traced(0.0)
    nowhere = np.zeros(SHAPE, dtype=bool)
    found, known = share_of_volume(
        truth.signal, truth.light, Sides(nowhere, nowhere), working(), (1, 3, 3)
    )
    assert not known.any()
    assert not found.any()
