"""OCT depth response, distinguished from attenuation in gel and lumens."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.scan import Scan
from registration.segmentation import SegmentationOptions, segment
from registration.segmentation.response import depth_response
from registration.segmentation.working import Working

STEP_MM, PIXEL_MM = 0.025, 0.04
SHAPE = (120, 80, 80)
TOP_MM, FOOT_MM = 0.3, 2.6
FADES = 0.8  # 1/mm, there and back
NOISE = 1e-3


def gel_share(lumens: bool) -> FloatArray:
    """Return a block with liquid around it, and with wide lumens along y in it."""
    z, _, x = np.meshgrid(
        STEP_MM * np.arange(SHAPE[0]),
        PIXEL_MM * np.arange(SHAPE[1]),
        PIXEL_MM * np.arange(SHAPE[2]),
        indexing="ij",
    )
    share = np.clip(0.5 + np.minimum(z - TOP_MM, FOOT_MM - z) / STEP_MM, 0, 1)
    share[:, :8], share[:, -8:] = 0, 0
    share[:, :, :8], share[:, :, -8:] = 0, 0
    if lumens:
        for x0, z0 in ((0.9, 0.9), (1.6, 1.9), (2.3, 1.2)):
            share *= np.clip(0.5 + (np.hypot(x - x0, z - z0) - 0.35) / STEP_MM, 0, 1)
    return share


def falls_to(least: float) -> FloatArray:
    """Return a response that falls to so much at the foot, (nz,)."""
    depth = np.clip((STEP_MM * np.arange(SHAPE[0]) - TOP_MM) / (FOOT_MM - TOP_MM), 0, None)
    return np.asarray(least ** (depth**1.5))


def scanned(share: FloatArray, response: FloatArray) -> NDArray[np.float32]:
    """Return speckle of two looks with its noise floor."""
    rng = np.random.default_rng(3)
    above = (np.cumsum(share, axis=0) - 0.5 * share) * STEP_MM
    mean = (share + 0.02 * (1 - share)) * np.exp(-FADES * above) * response[:, None, None]
    return ((mean + NOISE) * rng.gamma(2.0, 0.5, SHAPE)).astype(np.float32)


def working() -> Working:
    size = np.array([PIXEL_MM, PIXEL_MM, STEP_MM])
    return Working((1, 1, 1), np.ones(3), size, np.zeros(3), 0.03)


@pytest.mark.parametrize("depth_down", [True, False])
def test_response_is_told_from_what_the_gel_takes(depth_down: bool) -> None:
    truth = falls_to(0.2)
    way = slice(None, None, 1 if depth_down else -1)
    signal = scanned(gel_share(True), truth)[way] - np.float32(NOISE)
    found = depth_response(np.ascontiguousarray(signal), NOISE, working(), depth_down)[way]
    rows = np.s_[round(TOP_MM / STEP_MM) + 4 : round(FOOT_MM / STEP_MM) - 4]
    off = np.log(found[rows] / truth[rows])
    assert np.ptp(off) < 0.35  # of 1.6 that the instrument takes, beside 1.8 that the gel does


def test_a_foot_below_a_lumen_has_no_pits() -> None:
    share = gel_share(True)
    scan = Scan(
        volume=scanned(share, falls_to(0.1)),
        voxel_mm=(STEP_MM, PIXEL_MM, PIXEL_MM),
        modality="oct",
        scale="linear",
        refractive_index=1.0,
        optical_depth=False,
        depth_down=True,
        came_from=Path("phantom"),
    )
    found = segment(scan, SegmentationOptions(working_voxel_mm=0.04))
    x, y, z = found.surface.vertices.T
    inside = (np.abs(x - 1.6) < 1.0) & (np.abs(y - 1.6) < 1.0) & (z > 2.3) & found.seen
    assert inside.sum() > 1000
    assert 1e3 * np.abs(z[inside] - FOOT_MM).max() < 50
