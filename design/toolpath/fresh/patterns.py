"""Make curved infill paths in a layer's region: gyroid or concentric."""

from __future__ import annotations

from typing import Final

import numpy as np
import shapely
from manifold3d import CrossSection, JoinType

from design.toolpath.fresh.contours import contours_of
from design.toolpath.fresh.paths import Paths, Role, gather, join
from design.toolpath.fresh.section import COLLINEAR_MM, rings
from design.toolpath.fresh.walls import build_walls
from kernels.arrays import FloatArray

#: Length of a gyroid's lines per area, times its period; the mean over a period of heights.
_GYROID: Final = 2.4574
#: Points on a period of a gyroid's line.
_FINENESS: Final = 24
#: Gyroid lines shorter than so many widths aren't worth a start and a stop.
_SHORTEST: Final = 2.0
_MOST_WALLS: Final = 100_000


def concentric_paths(
    inside: CrossSection, width_mm: float, density: float, least: float, first_level: int
) -> Paths:
    """Rings along the region's boundary, from the outside in, ``width_mm / density`` apart.

    ``first_level`` is the number of the first ring, the walls outside it counted.
    """
    if density <= 0:
        return join([])
    if density >= 1:
        walls = build_walls(inside, width_mm, _MOST_WALLS, least).paths
        level = np.where(walls.role == Role.WALL, walls.level + first_level, 0)
        return Paths(walls.points, walls.width_mm, walls.offset, walls.closed, walls.role, level)
    parts: list[Paths] = []
    while True:
        inward = (0.5 + len(parts)) * width_mm / density
        centre = inside.offset(-inward, JoinType.Miter, 2.0).simplify(COLLINEAR_MM)
        if centre.is_empty():
            return join(parts)
        lines = contours_of(centre)
        points = np.split(lines.points, lines.offset[1:-1])
        widths = [np.full(len(ring), width_mm) for ring in points]
        ring = first_level + len(parts)
        parts.append(gather(points, widths, closed=True, role=Role.WALL, level=ring))


def gyroid_paths(
    inside: CrossSection, width_mm: float, density: float, z_mm: float, origin: FloatArray
) -> Paths:
    """Lines of the surface sin x cos y + sin y cos z + sin z cos x = 0 at one height.

    Two layers' lines cross where the surface turns, so that the infill is one piece and open in
    every direction: what flows round cells can flow through it.
    """
    if density <= 0 or inside.is_empty():
        return join([])
    period = _GYROID * width_mm / density
    region = _polygon(inside)
    low, high = np.array(shapely.bounds(region)).reshape(2, 2) - origin
    lines = gyroid_lines(low, high, z_mm, period)
    clipped = shapely.intersection(shapely.linestrings([line + origin for line in lines]), region)
    parts = shapely.get_parts(shapely.line_merge(clipped[~shapely.is_empty(clipped)]))
    kept = [
        shapely.get_coordinates(part)
        for part in parts
        if shapely.get_type_id(part) == 1 and shapely.length(part) >= _SHORTEST * width_mm
    ]
    widths = [np.full(len(line), width_mm) for line in kept]
    return gather(kept, widths, closed=False, role=Role.INFILL)


def gyroid_lines(
    low: FloatArray, high: FloatArray, z_mm: float, period_mm: float
) -> list[FloatArray]:
    """Lines (k, 2), mm, that cover the box from ``low`` to ``high``.

    Where |cos z| is large each line is y(x), else x(y), "upright": solved for the one, the
    equation is R sin(v + φ) = c with |c| <= R throughout.
    """
    turn = 2 * np.pi / period_mm
    z = turn * z_mm
    upright = abs(np.cos(z)) < np.sqrt(0.5)
    along, across = (1, 0) if upright else (0, 1)
    count = int(np.ceil((high[along] - low[along]) / period_mm * _FINENESS)) + 1
    u = turn * np.linspace(low[along], high[along], max(count, 2))
    if upright:  # cos y sin x + sin z cos x = -sin y cos z
        size, phase = np.hypot(np.cos(u), np.sin(z)), np.arctan2(np.sin(z), np.cos(u))
        right = -np.sin(u) * np.cos(z)
    else:  # cos z sin y + sin x cos y = -sin z cos x
        size, phase = np.hypot(np.cos(z), np.sin(u)), np.arctan2(np.sin(u), np.cos(z))
        right = -np.sin(z) * np.cos(u)
    half = np.arcsin(np.clip(right / size, -1, 1))
    phase = np.unwrap(phase)
    lines = []
    for branch in (half - phase, np.pi - half - phase):
        first = int(np.floor((turn * low[across] - branch.max()) / (2 * np.pi)))
        last = int(np.ceil((turn * high[across] - branch.min()) / (2 * np.pi)))
        for k in range(first, last + 1):
            line = np.empty((len(u), 2))
            line[:, along], line[:, across] = u / turn, (branch + 2 * np.pi * k) / turn
            lines.append(line)
    return lines


def _polygon(section: CrossSection) -> shapely.Geometry:
    polygon = shapely.Polygon()
    for ring in rings(section):
        polygon = shapely.symmetric_difference(polygon, shapely.Polygon(ring))
    return polygon
