"""Lift heights of ink on sunken ground, by an earlier map.

Ink is laid onto what lies there. Where that sank since it was designed, whole ink lies as much too
low, and looks missing; but it stands a layer over what the last map showed. How far the ground sank
is seen in the ink beside, so that a gap in a hollow is lifted with it, and remains a gap.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray
from printctl.inspection.pictures.picture import (
    HIGHEST_THICKNESSES,
    LAYER_TOP_THICKNESSES,
    LOWEST_THICKNESSES,
)
from printctl.inspection.values import FloatImage

_MIN_RISE_THICKNESSES: Final = 0.5
"""Least rise of fresh ink, in thicknesses."""
_BRIDGE_THICKNESSES: Final = 1.4
"""Rise, in thicknesses, from which on ink bridges a deeper hollow, and shows no sinking."""
_UNLIFTED_THICKNESSES: Final = 0.1
"""Depth that isn't lifted, in thicknesses: sound ink lies as low."""
_MIN_REPORTED_THICKNESSES: Final = 0.3
"""Least sinking that is reported, in thicknesses."""
_NEAR_SIGMA_WIDTHS: Final = 1.0
"""Standard deviation of the filter for risen ink, in line widths."""
_FAR_SIGMA_WIDTHS: Final = 4.0
"""The same where no risen ink is near: a line that is missing, or was lost in the earlier map."""
_MIN_RISEN_SHARE: Final = 0.05
"""Least share of risen ink around a cell."""
_MIN_WEIGHT: Final = 1e-3
"""Least filter weight for a mean to be defined."""


def lift_sunken_ink(
    picture: FloatImage,
    hidden: BoolArray,
    rise_mm: FloatImage,
    thickness_mm: float,
    width_px: float,
) -> tuple[FloatImage, float]:
    """Return a picture with sunken ink at its designed height, and the largest lift, mm.

    The lift is 0 where heights show the ink without it.

    Parameters
    ----------
    picture : (rows, columns, 2) float32
        Of `surface_of`.
    hidden : (rows, columns) bool
        Not seen.
    rise_mm : (rows, columns) float32, mm
        Over the surface that the layer was laid onto; NaN where either isn't known.
    thickness_mm : float, mm
    width_px : float
        Of a line.
    """
    height, rise = picture[:, :, 1] / thickness_mm, rise_mm / thickness_mm
    risen = np.nan_to_num(rise, nan=0.0)
    rose = (risen > _MIN_RISE_THICKNESSES) & (risen < _BRIDGE_THICKNESSES)
    low = np.where(rose, np.minimum(risen, 1.0) - LAYER_TOP_THICKNESSES - height, 0.0)
    sunk, share = _averaged(low, rose, _NEAR_SIGMA_WIDTHS * width_px)
    far, _ = _averaged(low, rose, _FAR_SIGMA_WIDTHS * width_px)
    lift = np.maximum(
        np.where(share > _MIN_RISEN_SHARE, sunk, far) - _UNLIFTED_THICKNESSES, 0.0
    ).astype(np.float32)
    bare = (share <= _MIN_RISEN_SHARE) & (
        rise <= _MIN_RISE_THICKNESSES
    )  # no higher than what lies where ink is missing
    lift = np.where(bare, np.clip(-LAYER_TOP_THICKNESSES - height, 0.0, lift), lift)
    if not lift[rose].any():
        return picture, 0.0
    level = np.clip(height + lift, LOWEST_THICKNESSES, HIGHEST_THICKNESSES)
    level[hidden] = LOWEST_THICKNESSES
    out = np.stack([level, (height + lift) * thickness_mm], axis=2).astype(np.float32)
    most = float(np.percentile(sunk[rose], 99))
    return out, most * thickness_mm if most > _MIN_REPORTED_THICKNESSES else 0.0


def _averaged(values: FloatImage, use: BoolArray, sigma_px: float) -> tuple[FloatImage, FloatImage]:
    """Return the mean of used values around each cell, 0 for none, and their share."""
    total, share = (
        cv2.GaussianBlur(one.astype(np.float32), (0, 0), sigma_px) for one in (values, use)
    )
    mean = np.where(share > _MIN_WEIGHT, total / np.maximum(share, np.float32(_MIN_WEIGHT)), 0.0)
    return mean.astype(np.float32), np.asarray(share)
