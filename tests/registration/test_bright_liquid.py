"""Segmentation where the liquid is nearly as bright as the gel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from registration.scan import Scan
from registration.segmentation import segment
from registration.segmentation.bright_liquid import first_light
from registration.segmentation.working import Working
from tests.slower import first_of

VOXEL_MM = (0.02, 0.035, 0.035)
RADIUS_MM = 0.3
MIDDLE_MM = np.array([1.0, 1.2])


def scan(liquid: float, noise: float = 0.004, seed: int = 1) -> Scan:
    """Return a block of gel with a round lumen along x, speckle of two looks, fading with depth."""
    rng = np.random.default_rng(seed)
    nz, ny, nx = 110, 70, 70
    z = (np.arange(nz) * VOXEL_MM[0])[:, None, None]
    y = (np.arange(ny) * VOXEL_MM[1])[None, :, None]
    x = (np.arange(nx) * VOXEL_MM[2])[None, None, :]
    aside = np.hypot(z - MIDDLE_MM[0], y - MIDDLE_MM[1])
    gel = (aside > RADIUS_MM) & (z > 0.2) & (z < 1.9) & (abs(y - 1.2) < 1.0) & (abs(x - 1.2) < 1.0)
    light = np.exp(-2 * np.cumsum(np.where(gel, 0.3, 0.03), axis=0) * VOXEL_MM[0])
    power = np.where(gel, 1.0, liquid) * light + noise
    volume = (power * rng.gamma(2.0, 0.5, power.shape)).astype(np.float32)
    return Scan(
        volume=volume,
        voxel_mm=VOXEL_MM,
        modality="oct",
        scale="linear",
        refractive_index=1.34,
        optical_depth=False,
        depth_down=True,
        came_from=Path("made"),
    )


@pytest.mark.parametrize("liquid", first_of([0.5, 0.02, 0.33, 0.4], 2))
def test_a_lumen_of_bright_liquid_has_its_diameter(liquid: float) -> None:
    found = segment(scan(liquid))
    z, y = found.surface.vertices[:, 2] - MIDDLE_MM[0], found.surface.vertices[:, 1] - MIDDLE_MM[1]
    aside, along = np.hypot(z, y), np.abs(found.surface.vertices[:, 0] - 1.2)
    wall = (aside < 2 * RADIUS_MM) & (along < 0.8)
    blur = found.field.blur_mm
    measured = aside[wall].mean() + blur**2 / (2 * RADIUS_MM)
    assert measured == pytest.approx(RADIUS_MM, abs=0.012)
    assert np.abs(aside[wall] - np.median(aside[wall])).max() < 0.15


@pytest.mark.slow
def test_a_scan_from_below_is_the_same_turned_round() -> None:
    down = scan(0.4)
    up = replace(down, volume=down.volume[::-1].copy(), depth_down=False)
    one, other = segment(down).field, segment(up).field
    assert one.blur_mm == pytest.approx(other.blur_mm, rel=0.05)
    inside = np.s_[8:-8, 8:-8, 8:-8]
    assert np.abs(one.values[inside] - other.values[::-1][inside]).mean() < 0.03


def test_deep_gel_darker_than_the_liquid_beside_it_is_gel() -> None:
    liquid = 0.5
    made = scan(liquid)
    power = np.random.default_rng(1).gamma(2.0, 0.5, (110, 110, 110))
    z, y, x = np.ogrid[:110, :110, :110]
    gel = (z >= 10) & (z < 95) & (abs(y - 55) < 28) & (abs(x - 55) < 28)
    light = np.exp(-2 * np.cumsum(np.where(gel, 0.6, 0.03), axis=0) * VOXEL_MM[0])
    power *= np.where(gel, 1.0, liquid) * light + 0.004
    made = replace(made, volume=power.astype(np.float32))
    working = Working.of(made, 0.02, 0.03)
    signal = working.binned(made)
    share = signal / first_light(signal, working)
    deep, aside = (z > 70) & (z < 90), (abs(y - 55) > 35) | (abs(x - 55) > 35)
    within = deep & (abs(y - 55) < 22) & (abs(x - 55) < 22)
    beside = deep & aside
    assert signal[within].mean() < signal[beside].mean()
    assert share[beside].mean() / share[within].mean() == pytest.approx(liquid, abs=0.15)
