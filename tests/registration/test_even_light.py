"""Light compensation by the gel's own level, without bright flat faces."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from registration.segmentation.even_light import even_signal
from registration.segmentation.working import Working

FloatVolume = NDArray[np.float32]
STEP_MM = 0.03
GEL = np.s_[15:85, 10:60, 10:60]


def working() -> Working:
    size = np.full(3, STEP_MM)
    return Working((1, 1, 1), np.ones(3), size, np.zeros(3), 0.03)


def speckle(level: FloatVolume, seed: int = 1) -> FloatVolume:
    """Return gel of a level, with the speckle of two looks, in liquid of 3 %."""
    rng = np.random.default_rng(seed)
    field = np.full((100, 70, 70), 0.03)
    field[GEL] = level[GEL]
    return (field * rng.gamma(2.0, 0.5, field.shape)).astype(np.float32)


def focused() -> FloatVolume:
    """Return a level that falls off from a focus in the middle, to a quarter each way."""
    depth = np.arange(100)[:, None, None]
    level = 4.0 ** (-(((depth - 50) / 40) ** 2)) * np.ones((1, 70, 70))
    return level.astype(np.float32)


def test_a_focus_in_the_gel_is_evened_out_from_top_to_foot() -> None:
    level = focused()
    light = even_signal(speckle(level), np.ones_like(level), working())
    inside = np.s_[18:82, 14:56, 14:56]
    ratio = level[inside] / light[inside]
    assert np.abs(ratio.mean(axis=(1, 2)) - 1).max() < 0.25
    assert np.abs(ratio - 1).mean() < 0.08
    # By the model alone a part of it lies below half of the level, where liquid is.
    assert (level[inside] < 0.5).mean() > 0.1


def test_hazy_liquid_in_a_thin_lumen_is_no_dim_gel() -> None:
    """The level of gel beside it came down to the liquid's: half of that is too narrow a lumen."""
    size = np.array([0.036, 0.06, 0.06])
    z, y = np.meshgrid(*(s * np.arange(60) for s in size[:2]), indexing="ij")
    off = np.hypot(z - 1.08, y - 1.8)[:, :, None] * np.ones(60)
    rng = np.random.default_rng(4)
    signal = np.where(off < 0.2, 0.3, 1.0) * rng.gamma(3.0, 1 / 3, off.shape)
    grid = Working((1, 1, 1), np.ones(3), size[::-1].copy(), np.zeros(3), 0.05)
    light = even_signal(signal.astype(np.float32), np.ones(off.shape, np.float32), grid)
    assert light[off < 0.35].mean() == pytest.approx(1.0, abs=0.05)
