"""Lift heights of ink whose ground has sunk, by an earlier map of what it was laid onto.

Ink is laid onto what lies there. Where that sank since it was designed, whole ink lies as much too
low, and looks missing; but it stands a layer over what the last map showed. How far the ground sank
is seen in the ink beside, so that a gap in a hollow is lifted with it, and remains a gap.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray
from registration.inspection.pictures.picture import HIGHEST, LOWEST
from registration.inspection.values import FloatImage

_ROSE: Final = 0.5
"""Of a layer, by which fresh ink has risen at least."""
_BRIDGES: Final = 1.4
"""Of a layer, from which on ink has bridged what lay deeper, and tells nothing of what sank."""
_TOP: Final = 0.5
"""Thicknesses from the layer's middle to its top."""
_LEFT: Final = 0.1
"""Of a layer, that isn't lifted: sound ink lies as low."""
_TOLD: Final = 0.3
"""Of a layer, from which on it is said."""
_AROUND: Final = 1.0
"""Widths of a line, over which risen ink is averaged."""
_FAR: Final = 4.0
"""The same where none is so near: a line that is missing, or was lost in the earlier map."""
_SHARE: Final = 0.05
"""Of what lies around, that must have risen."""
_NONE: Final = 1e-3


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
    risen = np.nan_to_num(rise, nan=0.0)
    rose = (risen > _ROSE) & (risen < _BRIDGES)
    low = np.where(rose, np.minimum(risen, 1.0) - _TOP - height, 0.0)
    sunk, share = _averaged(low, rose, _AROUND * width_px)
    far, _ = _averaged(low, rose, _FAR * width_px)
    lift = np.maximum(np.where(share > _SHARE, sunk, far) - _LEFT, 0.0).astype(np.float32)
    bare = (share <= _SHARE) & (rise <= _ROSE)  # no higher than what lies where ink is missing
    lift = np.where(bare, np.clip(-_TOP - height, 0.0, lift), lift)
    if not lift[rose].any():
        return picture, 0.0
    level = np.clip(height + lift, LOWEST, HIGHEST)
    level[hidden] = LOWEST
    out = np.stack([level, (height + lift) * thickness_mm], axis=2).astype(np.float32)
    most = float(np.percentile(sunk[rose], 99))
    return out, most * thickness_mm if most > _TOLD else 0.0


def _averaged(values: FloatImage, use: BoolArray, sigma_px: float) -> tuple[FloatImage, FloatImage]:
    """Mean of values around each cell that are used, 0 where there are none, and their share."""
    total, share = (
        cv2.GaussianBlur(one.astype(np.float32), (0, 0), sigma_px) for one in (values, use)
    )
    mean = np.where(share > _NONE, total / np.maximum(share, np.float32(_NONE)), 0.0)
    return mean.astype(np.float32), np.asarray(share)
