"""Open share of upright round lumens among printed lines; exact for stadiums.

Shares no code with the product.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.checkers.read_gcode import Lines

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Openings:
    """Largest circle about each lumen's axis that no line enters.

    Attributes
    ----------
    diameter : (layers, lumens) float64, mm
        0 where a line crosses the axis.
    """

    diameter: FloatArray

    def errors_um(self, designed_mm: FloatArray) -> FloatArray:
        """Median over the layers of measured minus designed, (lumens,), µm."""
        found: FloatArray = np.median(self.diameter, axis=0) - designed_mm
        return 1e3 * found


def openings(lines: Lines, centre: FloatArray, reach_mm: float) -> Openings:
    """Measure every lumen in every layer; ``reach_mm`` is beyond the widest lumen's radius."""
    rows = []
    for z in np.unique(np.round(lines.z, 4)):
        here = np.flatnonzero(np.abs(lines.z - z) < 1e-3)
        rows.append(_layer(lines, here, centre, reach_mm))
    return Openings(np.array(rows))


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


def crossings(
    trips: list[FloatArray], centre: FloatArray, radius: FloatArray, layer_mm: float
) -> int:
    """How many trips pass over an open lumen with the tip less than two layers above the ink.

    A trip is compared with the height of the lower of its ends; touching the rim isn't crossing.
    """
    tree, crossed = cKDTree(centre), 0
    for trip in trips:
        low = min(trip[0, 2], trip[-1, 2])
        crossed += any(
            _passes(a, b, tree, centre, radius)
            for a, b in pairwise(trip)
            if min(a[2], b[2]) < low + 2 * layer_mm - 1e-9
        )
    return crossed


def _passes(
    a: FloatArray, b: FloatArray, tree: cKDTree, centre: FloatArray, radius: FloatArray
) -> bool:
    length = float(np.linalg.norm(b[:2] - a[:2]))
    near = tree.query_ball_point((a[:2] + b[:2]) / 2, length / 2 + float(radius.max()))
    if length == 0 or not near:
        return False
    count = len(near)
    away = _to_segment(centre[near], np.tile(a[:2], (count, 1)), np.tile(b[:2], (count, 1)))
    return bool((away < radius[near] - 1e-3).any())


def unfilled(lines: Lines, z: float, material: shapely.Geometry) -> float:
    """Part of a layer's material that no line covers; exact union of stadiums."""
    here = np.abs(lines.z - z) < 1e-3
    ways = shapely.linestrings(np.stack([lines.start[here], lines.end[here]], axis=1))
    inked = shapely.union_all(shapely.buffer(ways, lines.width[here] / 2, quad_segs=16))
    return float(shapely.area(shapely.difference(material, inked)) / shapely.area(material))
