"""Widest free circle in planes across a lumen, of any centre.

Shares no code with the product. What is free is traced as a polygon of `RAYS` corners about the
axis; the widest circle in it is Shapely's. Lengths are mm.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks.checkers.bead_lumens import Axis, free_outline
from benchmarks.checkers.read_gcode import Lines

FloatArray = NDArray[np.float64]
RAYS = 360
SETTLED_MM = 1e-4
STEEP = 0.5
"""Least rise of a lumen whose sections are taken where lines are widest."""


def along_path(name: str, path: FloatArray, radius: float, step_mm: float) -> Axis:
    """Evenly spaced points of a whole path (n, 3), its ends left out, no farther apart."""
    length = np.linalg.norm(np.diff(path, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(length)])
    count = int(np.ceil(at[-1] / step_mm))
    where = (np.arange(count) + 0.5) / count * at[-1]
    point = np.column_stack([np.interp(where, at, column) for column in path.T])
    piece = np.clip(np.searchsorted(at, where) - 1, 0, len(length) - 1)
    along = (np.diff(path, axis=0) / length[:, None])[piece]
    return Axis(name, point, along, np.full(count, 2 * radius))


def at_mid_layer(axis: Axis, lines: Lines, layer_mm: float) -> Axis:
    """Points of a steep lumen, moved along it to the middle of their layer; others as they are.

    A level section between two layers would look into the notch of the lines' round sides.
    """
    top = np.unique(np.round(lines.z, 4))
    layer = np.clip(np.searchsorted(top, axis.point[:, 2]), 0, len(top) - 1)
    rise = axis.along[:, 2]
    steep = np.abs(rise) > STEEP
    up = top[layer] - layer_mm / 2 - axis.point[:, 2]
    way = np.where(steep, up / np.where(steep, rise, 1.0), 0.0)
    return Axis(axis.name, axis.point + way[:, None] * axis.along, axis.along, axis.diameter)


def widest_circles(lines: Lines, layer_mm: float, axis: Axis) -> FloatArray:
    """Diameter of the widest free circle at each point of an axis, beads with round sides, mm."""
    outlines = free_outline(lines, layer_mm, axis, RAYS)
    turn = (np.arange(RAYS) + 0.5) / RAYS * 2 * np.pi
    found = []
    for way in outlines:
        ring = way[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
        free = shapely.Polygon(ring)
        touches = shapely.maximum_inscribed_circle(free, tolerance=SETTLED_MM)
        found.append(2 * shapely.length(touches) if way.min() > 0 else 0.0)
    return np.array(found)
