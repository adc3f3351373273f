"""Tell filaments that an OCT shows by their rim: its height, and how much of it is there."""

from __future__ import annotations

from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray
from registration.inspection.ink.ink_image import ACROSS, Template
from registration.inspection.values import FloatImage

_SHOWN: Final = 0.1
"""Of the middle's height, from which on edges of the other sign are a rim."""
LOBE: Final = (0.2, 0.65)
"""Expected widths from the middle, between which a rim is looked for."""
_NEAR_RIM: Final = (np.abs(ACROSS) >= LOBE[0]) & (np.abs(ACROSS) <= LOBE[1])


def lobe(mean: FloatArray) -> tuple[float, float]:
    """Sign and height of the rim of a mean profile."""
    own = np.where(_other_sign(mean), mean, 0.0)
    own = own if own.any() else np.where(_NEAR_RIM, mean, 0.0)
    height = float(own[np.argmax(np.abs(own))])
    return float(np.sign(height)), abs(height)


def _core(mean: FloatArray) -> float:
    return float(mean[np.abs(ACROSS) < 0.15].mean())


def has_rim(template: Template) -> bool:
    """Whether ink shows most at its edges, or those differ from the bath otherwise than it does."""
    values = template.values
    brighter = lobe(values)[1] > (1.0 + _SHOWN) * abs(_core(values))
    return not template.filled or brighter or bool(_other_sign(values).any())


def rim_share(template: Template) -> float:
    """Height of a rim of the other sign than the filled middle, over that of the middle."""
    values = template.values
    core = abs(_core(values))
    rim = np.abs(values[_other_sign(values)])
    return float(rim.max()) / core if template.filled and len(rim) else 0.0


def shows_rim(template: Template) -> bool:
    """Whether edges of filled ink differ from the bath otherwise than its middle."""
    return template.filled and bool(_other_sign(template.values).any())


def rim_presence(profiles: FloatImage, template: Template) -> FloatArray:
    """Presence of a rim about a filled middle of the other sign, (n,): the less of both sides.

    How dark the middle is changes with the way that light has gone through ink, where a rim stays.
    """
    rim = np.where(_other_sign(template.values), template.values, 0.0)
    sides = [np.where(way * ACROSS > 0, rim, 0.0) for way in (1, -1)]
    each = [profiles @ side / float(side @ side) for side in sides]
    return np.asarray(np.minimum(*each), dtype=np.float64)


def _other_sign(values: FloatArray) -> BoolArray:
    """Places of a mean profile (61,) that differ from the bath otherwise than its middle."""
    core = _core(values)
    return np.asarray(_NEAR_RIM & (-values * np.sign(core) > _SHOWN * abs(core)))
