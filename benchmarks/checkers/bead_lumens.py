"""Free cross-section of lumens among printed lines; widths from each line's own extrusion.

Shares no code with the product. A line is a slab as high as its layer, as wide as the crest of its
round-sided bead (`flat`), or that bead itself (`rounded`). Rays go out from a lumen's axis, in the
plane across it, to the nearest ink. Lengths are mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.compiled import compiled
from benchmarks.checkers.read_gcode import Lines

FloatArray = NDArray[np.float64]
RAYS = 64
CLOSE = 1e-5


@dataclass(frozen=True)
class Axis:
    """Points on a lumen's axis that are to be measured.

    Attributes
    ----------
    name : str
    point, along : (n, 3) float64, mm
        Place, and unit vector of the axis.
    diameter : (n,) float64, mm
        As designed.
    """

    name: str
    point: FloatArray
    along: FloatArray
    diameter: FloatArray


@dataclass(frozen=True)
class Free:
    """What is free at each point of an axis: (n,) float64, mm.

    Attributes
    ----------
    round : of the circle of the free area
    inner : of the widest circle about the axis
    """

    round: FloatArray
    inner: FloatArray


def free_sections(lines: Lines, layer_mm: float, axis: Axis, *, rounded: bool) -> Free:
    """Measure an axis' sections."""
    way = free_outline(lines, layer_mm, axis, RAYS, rounded=rounded)
    return Free(2 * np.sqrt(np.mean(way**2, axis=1)), 2 * way.min(axis=1))


def free_outline(
    lines: Lines, layer_mm: float, axis: Axis, rays: int, *, rounded: bool = True
) -> FloatArray:
    """Way to the nearest ink at evenly spread angles about each point, (n, rays), mm."""
    top = np.round(lines.z, 4)
    order = np.argsort(top, kind="stable")
    top = top[order]
    data = np.column_stack([lines.start, lines.end, lines.width / 2, lines.z - layer_mm / 2])[order]
    turn = (np.arange(rays) + 0.5) / rays * 2 * np.pi
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    return np.array(
        [
            _section(data, top, layer_mm, *row, circle, rounded)
            for row in zip(axis.point, axis.along, axis.diameter, strict=True)
        ]
    )


def _section(
    data: FloatArray,
    top: FloatArray,
    layer: float,
    point: FloatArray,
    along: FloatArray,
    diameter: float,
    circle: FloatArray,
    rounded: bool,
) -> FloatArray:
    reach = diameter / 2 + 0.15
    low, high = np.searchsorted(top, [point[2] - reach - layer, point[2] + reach + 2 * layer])
    near = data[low:high]
    box = np.abs(near[:, [0, 1]] + near[:, [2, 3]] - 2 * point[:2]) / 2
    half = np.abs(near[:, [2, 3]] - near[:, [0, 1]]) / 2 + near[:, 4:5]
    near = near[(box - half < reach).all(axis=1)]
    one = np.cross(along, [0.0, 0.0, 1.0] if abs(along[2]) < 0.9 else [1.0, 0.0, 0.0])
    one /= np.linalg.norm(one)
    two = np.cross(along, one)
    rays = circle @ np.array([one, two])
    return _trace(np.ascontiguousarray(near), layer / 2, point, rays, reach, rounded)


@compiled
def _trace(
    near: FloatArray, r: float, point: FloatArray, rays: FloatArray, reach: float, rounded: bool
) -> FloatArray:
    """Way along each ray to the nearest ink, by steps as long as the way to it in any direction."""
    found = np.empty(len(rays))
    for k in range(len(rays)):
        t = 0.0
        for _ in range(400):
            x, y, z = (
                point[0] + t * rays[k, 0],
                point[1] + t * rays[k, 1],
                point[2] + t * rays[k, 2],
            )
            gap = reach
            for j in range(len(near)):
                up = abs(z - near[j, 5])
                if up - r >= gap:
                    continue
                ax, ay = near[j, 2] - near[j, 0], near[j, 3] - near[j, 1]
                px, py = x - near[j, 0], y - near[j, 1]
                size = ax * ax + ay * ay
                share = min(1.0, max(0.0, (px * ax + py * ay) / size)) if size > 0 else 0.0
                away = np.sqrt((px - share * ax) ** 2 + (py - share * ay) ** 2)
                if rounded:
                    flat = max(near[j, 4] - r, 0.0)
                    ball = min(r, near[j, 4])
                    side = max(away - flat, 0.0)
                    gap = min(gap, np.sqrt(side * side + up * up) - ball)
                else:
                    side, over = max(away - near[j, 4], 0.0), max(up - r, 0.0)
                    gap = min(gap, np.sqrt(side * side + over * over))
            if gap < CLOSE:
                break
            t += gap
            if t >= reach:
                t = reach
                break
        found[k] = t
    return found
