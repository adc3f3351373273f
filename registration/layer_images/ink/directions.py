"""Tell directions in which a picture hardly shows lines as they should look."""

from __future__ import annotations

import numpy as np

from registration.layer_images.ink.presence import INK
from registration.layer_images.values import BoolArray, FloatArray

_SECTORS = 12
_LEAST_INK = 0.7
_FEW_ALIKE = 20


def unlearned(angle: FloatArray, present: FloatArray) -> BoolArray:
    """Places of directions in which hardly any line looks as it should, (n,).

    Light from the side shows lines by their slopes; what a direction looks like is known only where
    lines of it were seen.
    """
    sector = np.floor((angle + np.pi) / (2 * np.pi) * _SECTORS).astype(np.int64) % _SECTORS
    number = np.bincount(sector, minlength=_SECTORS)
    ink = np.bincount(sector, weights=present > INK, minlength=_SECTORS)
    return np.asarray((ink < _LEAST_INK * np.maximum(number, _FEW_ALIKE))[sector])
