"""Lift heights of ink whose ground has sunk, by an earlier map of what it was laid onto.

Ink is laid onto what lies there. Where that sank since it was designed, whole ink lies as much too
low, and looks missing; but it stands a layer over what the last map showed. How far the ground sank
is seen in the ink beside, so that a gap in a hollow is lifted with it, and remains a gap.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from registration.layer_images.heights.surface import GROUND, HIGHEST
from registration.layer_images.values import BoolArray, FloatImage

_ROSE: Final = 0.5
"""Of a layer, by which fresh ink has risen at least."""
_TOP: Final = 0.5
"""Thicknesses from the layer's middle to its top."""
_LEFT: Final = 0.1
"""Of a layer, that isn't lifted: sound ink lies as low."""
_TOLD: Final = 0.3
"""Of a layer, from which on it is said."""
_AROUND: Final = 1.0
"""Widths of a line, over which risen ink is averaged."""
_SHARE: Final = 0.05
"""Of what lies around, that must have risen."""


def lifted(
    picture: FloatImage,
    hidden: BoolArray,
    rise_mm: FloatImage,
    thickness_mm: float,
    width_px: float,
) -> tuple[FloatImage, float]:
    """Return a picture with sunken ink at its designed height, and by how much at most, mm.

    0 for so little that heights would tell the ink without it.

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
    rose = np.nan_to_num(rise, nan=0.0) > _ROSE
    low = np.where(rose, np.minimum(np.nan_to_num(rise), 1.0) - _TOP - height, 0.0)
    total, share = (
        cv2.GaussianBlur(one.astype(np.float32), (0, 0), _AROUND * width_px) for one in (low, rose)
    )
    sunk = np.where(share > _SHARE, total / np.maximum(share, np.float32(_SHARE)), 0.0)
    lift = np.maximum(sunk - _LEFT, 0.0).astype(np.float32)
    if not lift[rose].any():
        return picture, 0.0
    level = np.clip(height + lift, GROUND, HIGHEST)
    level[hidden] = GROUND
    out = np.stack([level, (height + lift) * thickness_mm], axis=2).astype(np.float32)
    most = float(np.percentile(sunk[rose], 99))
    return out, most * thickness_mm if most > _TOLD else 0.0
