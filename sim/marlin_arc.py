"""The points of an arc (G2, G3) as the firmware cuts it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.gcode_modal import arc_points
from sim.planner_state import Records


def arc_of(
    begin: NDArray[np.float64], target: NDArray[np.float64], words: Records, unit: float
) -> NDArray[np.float64]:
    """Ends of the arc's pieces, (n, 4), mm; none where it has no centre."""
    points = np.empty((256, 4))
    count = arc_points(begin, target, words[0], unit, points)
    if count > len(points):
        points = np.empty((count, 4))
        arc_points(begin, target, words[0], unit, points)
    return begin[None] if count < 0 else points[:count]
