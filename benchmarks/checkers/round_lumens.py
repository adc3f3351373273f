"""Open share of upright round lumens among printed lines; exact for stadiums.

Shares no code with the product.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks.checkers.read_gcode import Lines

FloatArray = NDArray[np.float64]


def openings(lines: Lines, centre: FloatArray, reach_mm: float) -> FloatArray:
    """Return the largest circle about each lumen's axis that no line enters, (layers, lumens), mm.

    ``reach_mm`` is beyond the widest lumen's radius; 0 where a line crosses the axis.
    """
    rows = []
    for z in np.unique(np.round(lines.z, 4)):
        here = np.flatnonzero(np.abs(lines.z - z) < 1e-3)
        rows.append(_layer(lines, here, centre, reach_mm))
    return np.array(rows)


def _layer(lines: Lines, here: NDArray[np.int64], centre: FloatArray, reach: float) -> FloatArray:
    start, end, half = lines.start[here], lines.end[here], lines.width[here] / 2
    boxes = shapely.STRtree(shapely.linestrings(np.stack([start, end], axis=1)))
    clear = np.full(len(centre), np.inf)
    lumen, line = boxes.query(shapely.points(centre), predicate="dwithin", distance=reach)
    distance = _to_segment(centre[lumen], start[line], end[line]) - half[line]
    np.minimum.at(clear, lumen, distance)
    return 2 * np.maximum(clear, 0.0)


def _to_segment(point: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    way = end - start
    share = ((point - start) * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), 1e-30)
    near = start + np.clip(share, 0, 1)[:, None] * way
    found: FloatArray = np.linalg.norm(point - near, axis=1)
    return found
