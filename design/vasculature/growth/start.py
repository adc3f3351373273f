"""Start a tree: connect its stem to the first two terminals that fit."""

from __future__ import annotations

import numpy as np

from design.errors import RootError
from design.tissue import Tissue
from kernels.arrays import FloatArray

# Find where the straight vessel of a tree with one terminal ends.

_LONGEST = 1000
"""Steps along each straight that is tried."""


def sole_end(
    tissue: Tissue, begin: FloatArray, ends: FloatArray, middle: FloatArray, depth_mm: float
) -> FloatArray:
    """The one of ``ends`` nearest to the middle that a straight vessel can reach.

    A vessel enters through the surface: twice its depth on it has to lie in the tissue, and once it
    is deep enough it has to stay so up to its end.

    Parameters
    ----------
    tissue : Tissue
    begin : (3,) float64, mm
        The root.
    ends : (n, 3) float64, mm
    middle : (3,) float64, mm
        Of what the terminal has to supply.
    depth_mm : float
        The vessel's radius and its wall.

    Raises
    ------
    RootError
        When none can be reached.
    """
    for end in ends[np.argsort(np.linalg.norm(ends - middle, axis=1), kind="stable")]:
        if _stays_deep(tissue, begin, end, depth_mm):
            return np.asarray(end, dtype=np.float64)
    raise RootError(
        f"no straight vessel of {depth_mm:.3g} mm with its wall leads from the root at "
        + "({:.4g}, {:.4g}, {:.4g}) mm to the one terminal; choose ".format(*begin)
        + "another place of the root, more terminals, a smaller smallest radius or clearance"
    )


def _stays_deep(tissue: Tissue, begin: FloatArray, end: FloatArray, depth_mm: float) -> bool:
    steps = int(np.linalg.norm(end - begin) / (0.25 * tissue.grid.spacing_mm)) + 2
    part = np.linspace(0.0, 1.0, min(steps, _LONGEST))
    depth = -tissue.grid.distance(begin + part[:, None] * (end - begin))
    entered = part * np.linalg.norm(end - begin) > 2.0 * depth_mm + tissue.grid.spacing_mm
    deep = depth >= depth_mm
    return bool(deep[-1] and deep[int(np.argmax(deep)) :].all() and (depth[entered] > 0).all())
