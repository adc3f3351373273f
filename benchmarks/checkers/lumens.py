"""Free cross-section of lumens among printed lines, and a layer's ink against its section.

Shares no code with the product. A line is a round-sided bead; of upright lumens its widest place
counts. Rays go out from a lumen's axis, in the plane across it, to the nearest ink. Lengths are mm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks.checkers.compiled import compiled
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


RAYS = 64
CLOSE = 1e-5


@dataclass(frozen=True)
class Axis:
    """Points (n, 3) on a lumen's axis, unit vectors along it, diameters (n,) as designed, mm."""

    name: str
    point: FloatArray
    along: FloatArray
    diameter: FloatArray


def free_diameters(lines: Lines, layer_mm: float, axis: Axis) -> FloatArray:
    """Return the diameter of the widest circle about each point that no ink enters, (n,), mm."""
    top = np.round(lines.z, 4)
    order = np.argsort(top, kind="stable")
    data = np.column_stack([lines.start, lines.end, lines.width / 2, lines.z - layer_mm / 2])[order]
    rows = zip(axis.point, axis.along, axis.diameter, strict=True)
    return np.array([2 * _section(data, top[order], layer_mm, *row).min() for row in rows])


def _section(
    data: FloatArray,
    top: FloatArray,
    layer: float,
    point: FloatArray,
    along: FloatArray,
    diameter: float,
) -> FloatArray:
    """Return the way to the nearest ink at evenly spread angles about a point, mm."""
    reach = diameter / 2 + 0.15
    low, high = np.searchsorted(top, [point[2] - reach - layer, point[2] + reach + 2 * layer])
    near = data[low:high]
    box = np.abs(near[:, [0, 1]] + near[:, [2, 3]] - 2 * point[:2]) / 2
    half = np.abs(near[:, [2, 3]] - near[:, [0, 1]]) / 2 + near[:, 4:5]
    near = near[(box - half < reach).all(axis=1)]
    one = np.cross(along, [0.0, 0.0, 1.0] if abs(along[2]) < 0.9 else [1.0, 0.0, 0.0])
    one /= np.linalg.norm(one)
    turn = (np.arange(RAYS) + 0.5) / RAYS * 2 * np.pi
    rays = np.column_stack([np.cos(turn), np.sin(turn)]) @ np.array([one, np.cross(along, one)])
    return _trace(np.ascontiguousarray(near), layer / 2, point, rays, reach)


@compiled
def _trace(
    near: FloatArray, r: float, point: FloatArray, rays: FloatArray, reach: float
) -> FloatArray:
    """Way along each ray to the nearest ink, by steps as long as the way to it in any direction."""
    found = np.empty(len(rays))
    for k in range(len(rays)):
        t = 0.0
        for _ in range(400):
            x, y = point[0] + t * rays[k, 0], point[1] + t * rays[k, 1]
            z, gap = point[2] + t * rays[k, 2], reach
            for j in range(len(near)):
                up = abs(z - near[j, 5])
                if up - r >= gap:
                    continue
                ax, ay = near[j, 2] - near[j, 0], near[j, 3] - near[j, 1]
                px, py = x - near[j, 0], y - near[j, 1]
                size = ax * ax + ay * ay
                share = min(1.0, max(0.0, (px * ax + py * ay) / size)) if size > 0 else 0.0
                away = np.sqrt((px - share * ax) ** 2 + (py - share * ay) ** 2)
                side = max(away - max(near[j, 4] - r, 0.0), 0.0)
                gap = min(gap, np.sqrt(side * side + up * up) - min(r, near[j, 4]))
            if gap < CLOSE:
                break
            t += gap
            if t >= reach:
                t = reach
                break
        found[k] = t
    return found


EVERY = 12


def bare_percent(lines: Lines, material: Callable[[float], shapely.Geometry]) -> float:
    """Return the share of material that no line covers, mean of every twelfth layer, %.

    ``material`` gives the section at mid-layer, in the lines' frame, for the tip's height.
    """
    bare: list[float] = []
    for z in np.unique(np.round(lines.z, 4))[4:-4:EVERY]:
        section = material(float(z))
        here = np.abs(lines.z - z) < 1e-3
        ways = shapely.linestrings(np.stack([lines.start[here], lines.end[here]], axis=1))
        ink = shapely.union_all(shapely.buffer(ways, lines.width[here] / 2, quad_segs=8))
        bare.append(shapely.difference(section, ink).area / section.area)
    return 100 * float(np.mean(bare))
