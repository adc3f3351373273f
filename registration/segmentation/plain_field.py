"""Segment gel and lumens in micro-CT and confocal volumes: smoothing and one threshold."""

from __future__ import annotations

from typing import Literal

import numpy as np

from registration.scan import Scan
from registration.segmentation.levels import part_levels, sparse_levels
from registration.segmentation.volume import GelField, Volume
from registration.segmentation.working import Working, probe


def plain_field(
    scan: Scan, working: Working, lumens: Literal["dark", "bright"], *, whole_part: bool = False
) -> tuple[GelField, float]:
    """Compute the gel field and contrast of a volume with uniform grey values.

    Of a ``whole_part`` the field shows its outside, too, which may be most of it.

    Raises
    ------
    SegmentationError
        When no lumen stands out.
    """
    values: Volume
    if max(working.bins) == 1 and scan.scale == "linear" and scan.volume.dtype == np.uint16:
        values = working.smoothed_counts(scan.volume.view(np.uint16))
    else:
        values = working.smoothed(working.binned(scan))
    sign = 1.0 if lumens == "dark" else -1.0
    levels = (part_levels if whole_part else sparse_levels)(sign * probe(values))
    field = GelField(
        values, levels.half, sign, working.voxel_mm, working.origin_mm, working.blur_mm
    )
    return field, levels.contrast
