"""Tell places whose line lies in a way that a picture hardly shows as it should look."""

from __future__ import annotations

import numpy as np

from kernels.arrays import BoolArray, FloatArray
from registration.inspection.ink.ink_image import Template
from registration.inspection.ink.presence import INK, Sides
from registration.inspection.ways import Ways

_ALONE = 0.8
"""Widths to the next ink: nearer, and edges by which ink is told may be missing."""
ASIDE = 0.1
"""Slant from which on each direction must show ink of its own."""
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


def untold(
    template: Template, sides: Sides, ways: Ways, angle: FloatArray, present: FloatArray
) -> BoolArray:
    """Places, (n,), that edges alone, or light from one side, don't tell."""
    none = np.zeros(len(ways), dtype=np.bool_)
    if template.by_edges:
        none |= (np.minimum(sides.left, sides.right) < _ALONE) | ways.corners()
    if template.one_sided or template.slant > ASIDE:
        none |= unlearned(angle, present)
    return none
