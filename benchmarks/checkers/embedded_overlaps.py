"""Find where vessels of a network overlap away from nodes, and count as one body.

Shares no code with the product. Two vessels overlap where their axes come nearer than the sum of
their radii, one of the two places further than J (see `embedded_shaft`) from every node that they
share; a vessel overlaps itself where that happens further apart along it than J.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from benchmarks.checkers.embedded_axes import Axes

FloatArray = NDArray[np.float64]


def overlaps_near(
    axes: Axes, one: int, other: int, places: FloatArray, needle_outer_mm: float
) -> bool:
    """Whether two vessels overlap, away from their nodes, within J of one of the places (k, 3)."""
    if one < 0 or other < 0:
        return False
    a, b = _dense(axes, one), _dense(axes, other)
    thick = max(a[:, 3].max(), b[:, 3].max())
    reach = np.sqrt(2.0) * (needle_outer_mm / 2 + thick) + thick / 2
    a, b = _near(a, places, reach), _near(b, places, reach)
    if not len(a) or not len(b):
        return False
    gap = np.linalg.norm(a[:, None, :3] - b[None, :, :3], axis=2)
    touch = gap < a[:, None, 3] + b[None, :, 3]
    if one == other:
        return bool((touch & (np.abs(a[:, None, 4] - b[None, :, 4]) > reach)).any())
    for node in set(axes.ends[one].tolist()) & set(axes.ends[other].tolist()):
        far = [np.linalg.norm(part[:, :3] - axes.node[node], axis=1) > reach for part in (a, b)]
        touch &= far[0][:, None] | far[1][None, :]
    return bool(touch.any())


def _dense(axes: Axes, vessel: int) -> FloatArray:
    """Points, radius and arc length along a vessel, (n, 5)."""
    own = np.flatnonzero(axes.vessel == vessel)
    return np.column_stack([np.asarray(axes.tree.data)[own], axes.radius[own], axes.arc[own]])


def _near(dense: FloatArray, places: FloatArray, reach: float) -> FloatArray:
    gap, _ = KDTree(places).query(dense[:, :3])
    return dense[gap <= reach]
