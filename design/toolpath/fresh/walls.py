"""Lay walls along a layer's contours, and lines in gaps; return the region left for infill."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from manifold3d import CrossSection, JoinType

from design.toolpath.fresh.contours import (
    contours_of,
    ring_areas,
    signed_area,
)
from design.toolpath.fresh.paths import Paths, Role, join
from design.toolpath.fresh.section import SLICING
from design.toolpath.fresh.thin_walls import gap_paths, wall_paths
from kernels import jit
from kernels.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Walls:
    """Walls of one layer and what they leave."""

    paths: Paths  # walls, and lines in the gaps that are too thin for one
    inside: CrossSection  # what the infill must cover


def build_walls(material: CrossSection, width_mm: float, count: int | None, least: float) -> Walls:
    """Lay ``count`` walls into ``material``, or with None as many as it holds.

    The i-th centreline lies (i + ½) w inside the boundary, so the first line's edge *is* the
    boundary and a lumen keeps its size. Places thinner than two walls are shared between them
    (`thin`), those thinner than one get one line as wide as they are, and those thinner than
    ``least`` widths none; the coverage report counts them.
    """
    parts: list[Paths] = []
    region = material
    for level in itertools.count() if count is None else range(count):
        if region.is_empty():
            break
        centre = _offset(material, -(level + 0.5) * width_mm)
        parts.append(wall_paths(contours_of(centre), width_mm, least, level))
        covered = _offset(centre, 0.5 * width_mm)
        parts.append(_gaps(region, covered, width_mm, least, between=level > 0))
        region = _offset(material, -(level + 1) * width_mm)
    # What is left between two last walls, narrower than an infill line, is a gap too.
    broad = _offset(_offset(region, -0.5 * width_mm), 0.5 * width_mm)
    parts.append(_gaps(region, broad, width_mm, least, between=True))
    return Walls(join(parts), broad)


def clear_of_lumens(material: CrossSection, clear_mm: float) -> CrossSection:
    """The material without what is nearer to a hole in it than ``clear_mm``.

    Below 0 the holes become smaller. A lumen that is open to the outside in this section is no
    hole in it and stays.
    """
    rings = material.to_polygons()
    holes = [ring[::-1] for ring in rings if signed_area(ring) < 0]
    if not holes or clear_mm == 0:
        return material
    made = CrossSection(holes).offset(clear_mm, JoinType.Miter, 2.0)
    if clear_mm > 0:
        return material - made
    return material + CrossSection(holes) - made


def moved_in(material: CrossSection, by_mm: float) -> CrossSection:
    """The material with its whole boundary moved inward."""
    return material if by_mm == 0 else _offset(material, -by_mm)


def _gaps(
    region: CrossSection, covered: CrossSection, width_mm: float, least: float, *, between: bool
) -> Paths:
    """Lines in the places of ``region`` that are thinner than a line: those not ``covered``."""
    half = 0.5 * least * width_mm
    if region.area() - covered.area() < half * width_mm:
        return join([])  # not even the shortest line that is worth it
    left = region - covered
    core = left.offset(-0.98 * half, JoinType.Miter, 2.0)
    if core.is_empty():
        return join([])
    # Corners and rounding fall away here; places as wide as a line that can be written stay.
    kept = contours_of(left ^ core.offset(2 * half, JoinType.Miter, 2.0))
    return gap_paths(kept, width_mm, least, between=between)


def _offset(section: CrossSection, by_mm: float) -> CrossSection:
    # Mitred: a facetted circle keeps its facets, where round joins would add points to each.
    return section.offset(by_mm, JoinType.Miter, 2.0).simplify(SLICING.collinear_mm)


# Firmware merges moves shorter than its least, and cuts the corner into the lumen where it likes.
# Here a short move goes by its two neighbours being drawn out until they meet, where the path bends
# round a lumen, or by leaving out a point, where it bends the other way. Both put the path on the
# side of the material, so that the circle inside a lumen stays as wide as it was. Along the part's
# outside neighbours are drawn out at bulges too, so that neither they nor sharp corners stay empty,
# but where another ink may lie there. A ring too small for many moves is drawn anew, as the tangent
# polygon of the most sides.
WALL: Final = int(Role.WALL)


class _ShortMoves(NamedTuple):
    """How short moves are removed; distances in line widths."""

    drawn_out: float = 0.3  # of a corner, at most; the moves beside it stay in their place
    left_out: float = 0.03  # off the path of points left out; long moves tilt by as much
    polygon: float = 0.5  # of a tangent polygon's corner off a ring too small for anything else
    small_ring: float = 4.0  # a ring no wider than so many least moves is small
    sides: int = 16  # of a tangent polygon, at most
    turns: int = 6  # positions tried of each
    rounds: int = 12  # over a path; each takes at most every other short move away


SHORT: Final = _ShortMoves()


def remove_short_moves(
    paths: Paths, least_mm: float, width_mm: float, *, beside_ink: bool = False
) -> Paths:
    """Take moves shorter than ``least_mm`` out of the walls, where `SHORT.drawn_out` lets that be.

    Parameters
    ----------
    paths : Paths
        Walls have the material's inside on their left.
    least_mm : float, mm
        Along the longer of x and y, which is what a firmware counts; 0 leaves all as it is.
    width_mm : float, mm
        Of a line.
    beside_ink : bool
        Whether another ink lies beside the outside: nothing is drawn out into it then.
    """
    if least_mm <= 0 or paths.number == 0:
        return paths
    paths = _small_rings_redrawn(paths, least_mm, width_mm)
    outer = paths.closed & (ring_areas(paths.points, paths.offset) > 0) & (not beside_ink)
    points, keep = _coarsened(paths, outer, least_mm, width_mm)
    offset = np.concatenate([[0], np.cumsum(keep)])[paths.offset]
    width = _merged_widths(paths, keep, offset)
    return paths._replace(points=points[keep], width_mm=width, offset=offset)


def _merged_widths(paths: Paths, keep: BoolArray, offset: IntArray) -> FloatArray:
    """Mean width, over their lengths, of the lines that became one; (kept,) float64, mm."""
    size, begin = np.diff(paths.offset), paths.offset[:-1]
    before = np.arange(-1, len(keep) - 1)
    before[begin] = np.where(paths.closed, paths.offset[1:] - 1, begin)
    length = np.hypot(*(paths.points - paths.points[before]).T) + 1e-12  # of an open begin 0
    # The next point that is kept, from a path's last one on its first.
    after: IntArray = np.cumsum(keep) - keep
    kept: IntArray = np.where(
        after < np.repeat(offset[1:], size), after, np.repeat(offset[:-1], size)
    )
    area = np.bincount(kept, length * paths.width_mm)
    return np.asarray(area / np.bincount(kept, length))


def _small_rings_redrawn(paths: Paths, least_mm: float, width_mm: float) -> Paths:
    """Rings round lumens too small for many moves, as tangent polygons where one fits."""
    rings = np.split(paths.points, paths.offset[1:-1])
    widths = np.split(paths.width_mm, paths.offset[1:-1])
    for k in np.flatnonzero(paths.closed & (paths.role == Role.WALL)):
        step = np.abs(np.diff(rings[k], axis=0, append=rings[k][:1])).max(axis=1)
        small = np.ptp(rings[k], axis=0).max() < SHORT.small_ring * least_mm
        if not small or step.min() >= least_mm or signed_area(rings[k]) >= 0:
            continue
        polygon = _tangent_polygon(rings[k], least_mm, SHORT.polygon * width_mm)
        if polygon is not None:
            rings[k], widths[k] = polygon, np.full(len(polygon), widths[k].mean())
    offset = np.cumsum([0, *map(len, rings)], dtype=np.int64)
    return paths._replace(
        points=np.concatenate(rings), width_mm=np.concatenate(widths), offset=offset
    )


def _tangent_polygon(ring: FloatArray, least_mm: float, most_mm: float) -> FloatArray | None:
    """Polygon of the most sides, none too short, whose sides touch the ring from outside."""
    for sides in range(SHORT.sides, 3, -1):
        for turn in range(SHORT.turns):
            angle = -2 * np.pi * (np.arange(sides) + turn / SHORT.turns) / sides  # clockwise
            normal = np.column_stack([np.cos(angle), np.sin(angle)])
            reach = (ring @ normal.T).max(axis=0)
            after, beyond = np.roll(normal, -1, axis=0), np.roll(reach, -1)
            sine = normal[:, 0] * after[:, 1] - normal[:, 1] * after[:, 0]
            corner = np.column_stack(
                [
                    (reach * after[:, 1] - beyond * normal[:, 1]) / sine,
                    (beyond * normal[:, 0] - reach * after[:, 0]) / sine,
                ]
            )
            step = np.abs(np.diff(corner, axis=0, append=corner[:1])).max(axis=1)
            if step.min() < least_mm:
                continue
            away = np.hypot(*(corner[:, None] - ring[None]).transpose(2, 0, 1)).min(axis=1)
            if away.max() <= most_mm:
                return corner
    return None


@jit
def _bend(points: FloatArray, a: int, b: int, c: int) -> float:
    """How far b stands to the right of the way from a to c; below 0 for the left."""
    x, y = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1]
    length = math.sqrt(x * x + y * y)
    if length == 0:
        return 0.0
    bend: float = (x * (points[a, 1] - points[b, 1]) - y * (points[a, 0] - points[b, 0])) / length
    return bend


@jit
def _drawn_out(
    points: FloatArray, a: int, b: int, c: int, d: int, most: float
) -> tuple[bool, float, float]:
    """Where the ways a to b and d to c meet beyond b and c, when that is near enough to both."""
    ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    vx, vy = points[c, 0] - points[d, 0], points[c, 1] - points[d, 1]
    cross = ux * vy - uy * vx
    if abs(cross) < 1e-15:
        return False, 0.0, 0.0
    wx, wy = points[d, 0] - points[a, 0], points[d, 1] - points[a, 1]
    s, t = (wx * vy - wy * vx) / cross, (wx * uy - wy * ux) / cross
    if s < 1 or t < 1:
        return False, 0.0, 0.0
    x, y = points[a, 0] + s * ux, points[a, 1] + s * uy
    ex, ey = points[c, 0] - points[b, 0], points[c, 1] - points[b, 1]
    length = math.sqrt(ex * ex + ey * ey)
    if length == 0:
        return False, 0.0, 0.0
    off = abs(ex * (y - points[b, 1]) - ey * (x - points[b, 0])) / length
    return off <= most, x, y


@jit
def _coarsened(
    paths: Paths, outer: BoolArray, least: float, line: float
) -> tuple[FloatArray, BoolArray]:
    """Points with short moves of walls taken out, and which are kept; ``line`` is a width, mm."""
    points, width, offset, closed = paths.points.copy(), paths.width_mm, paths.offset, paths.closed
    keep = np.ones(len(points), np.bool_)
    after, before = np.empty(len(points), np.int64), np.empty(len(points), np.int64)
    # How far the points that were left out may stand from the way that begins at each point.
    off = np.zeros(len(points))
    for p in range(len(closed)):
        low, high = offset[p], offset[p + 1]
        left = high - low
        if paths.role[p] != WALL or left < 4:
            continue
        for k in range(low, high):
            after[k], before[k] = k + 1, k - 1
        after[high - 1], before[low] = low, high - 1
        for _ in range(SHORT.rounds):
            changed = False
            for b in range(low, high):
                c = after[b]
                if not keep[b] or left < 4 or (not closed[p] and (b == low or c <= b)):
                    continue
                short = max(abs(points[c, 0] - points[b, 0]), abs(points[c, 1] - points[b, 1]))
                if short >= least or (not closed[p] and c == high - 1):
                    continue
                a, d = before[b], after[c]
                at_b, at_c = _bend(points, a, b, c), _bend(points, b, c, d)
                without_b = at_b + max(off[a], off[b]) if at_b >= 0 else np.inf
                without_c = at_c + max(off[b], off[c]) if at_c >= 0 else np.inf
                met, x, y = False, 0.0, 0.0
                bulges = outer[p] and at_b > 0 and at_c > 0 and width[b] == width[c]
                if bulges or (at_b < 0 and at_c < 0):
                    met, x, y = _drawn_out(points, a, b, c, d, SHORT.drawn_out * line)
                if met:
                    points[b, 0], points[b, 1] = x, y
                    off[b] = off[c]
                    gone = c
                elif min(without_b, without_c) <= SHORT.left_out * line:
                    gone = b if without_b <= without_c else c
                    # Lines that become narrower stay as many as the firmware takes.
                    long = max(abs(points[b, 0] - points[a, 0]), abs(points[b, 1] - points[a, 1]))
                    if (
                        width[b] != width[c]
                        and long >= least
                        and without_c <= SHORT.left_out * line
                    ):
                        gone = c
                    off[before[gone]] = without_b if gone == b else without_c
                else:
                    continue
                keep[gone] = False
                after[before[gone]], before[after[gone]] = after[gone], before[gone]
                left -= 1
                changed = True
            if not changed:
                break
    return points, keep
