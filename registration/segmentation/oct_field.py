"""Gel and liquid in OCT: noise floor, attenuation, Otsu, and the local level of the gel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from registration.errors import SegmentationError
from registration.scan import Scan
from registration.segmentation.filters import bin_mean, divide_by_field
from registration.segmentation.levels import Levels, balanced_levels
from registration.segmentation.light import light_left
from registration.segmentation.volume import GelField, Strength
from registration.segmentation.working import Working, probe

FloatVolume = NDArray[np.float32]


def oct_field(scan: Scan, working: Working) -> tuple[GelField, float, Strength]:
    """Where the gel lies in an OCT volume, the contrast, and how much light came back.

    Raises
    ------
    SegmentationError
        When gel and liquid can't be told apart.
    """
    signal = working.binned(scan)
    noise = float(np.percentile(probe(bin_mean(signal, (4, 4, 4), False, 0.0)), 1))
    signal -= np.float32(noise)
    step = float(working.voxel_mm[2])
    light, typical = light_left(signal, step, 3 * noise, working.voxel_mm[:2], scan.depth_down)
    # Reflections would spill over their neighbours.
    values = working.smoothed(np.minimum(signal / light, np.float32(3 * typical)))
    rough = balanced_levels(probe(values))
    level, factor = _gel_level(values, rough, working)
    divide_by_field(values, level, factor)
    levels = balanced_levels(probe(values))
    if levels.contrast < 3:
        raise SegmentationError(
            f"gel and liquid can't be told apart: their grey values differ by "
            f"{levels.contrast:.1f} standard deviations of the gel (needed: 3); check that the "
            "gel is the brighter, that scale is right, and the exposure"
        )
    field = GelField(values, levels.half, 1.0, working.voxel_mm, working.origin_mm, working.blur_mm)
    return field, levels.contrast, Strength(signal, noise)


def _gel_level(
    values: FloatVolume, rough: Levels, working: Working
) -> tuple[FloatVolume, tuple[int, int, int]]:
    """Local brightness of the gel over 0.5 mm, on a coarse grid, and the grid's factor."""
    factor = np.maximum(1, np.round(0.2 / working.voxel_mm[::-1])).astype(int)
    fz, fy, fx = np.minimum(factor, values.shape).tolist()
    coarse = (fz, fy, fx)
    gel = values > rough.half
    weight = bin_mean(gel, coarse, False, 0.0)
    total = bin_mean(np.where(gel, values, np.float32(0)), coarse, False, 0.0)
    sigma = 0.5 / (working.voxel_mm[::-1] * factor)
    weight = gaussian_filter(weight, sigma, mode="nearest")
    total = gaussian_filter(total, sigma, mode="nearest")
    # Far from any gel the rough level stands.
    few = np.float32(0.02)
    level = (total + few * np.float32(rough.gel)) / (weight + few)
    return np.ascontiguousarray(level, dtype=np.float32), coarse
