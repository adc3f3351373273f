"""Fill a layer's region with straight parallel infill lines, clipped by scan conversion.

A line is a strip one width high. Where the region ends inside a strip, along a boundary nearly
parallel to the lines, a whole line would leave or overfill up to half a width; there a line of
half the width is written in the half of the strip that lies inside.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import shapely
from manifold3d import CrossSection, JoinType
from numpy.typing import NDArray

from design.toolpath.fresh.contours import Cells, contours_of, crossing
from design.toolpath.fresh.paths import Paths, Role, WritingOrder, gather, join
from design.toolpath.fresh.section import SLICING, rings
from design.toolpath.fresh.walls import build_walls
from kernels.arrays import FloatArray, IntArray


class _LineLimits(NamedTuple):
    """Limits of straight lines and of joints between them, in line widths unless said."""

    whole: float = 0.5  # shortest whole line that is worth a start and a stop
    half: float = 2.0  # shortest half line
    curved: float = 2.0  # shortest gyroid line
    stretch: float = 0.05  # by which lines that fill a region may differ in width to fit in it
    joint_gap: float = 1.3  # lines further apart aren't joined: the joint would stand off the wall
    joint_width: float = 0.5  # of the widest line; a joint is no wider than its narrower line
    rest: float = 0.5  # what must be left of a line between its joints
    parallel: float = 0.9999  # least cosine between two lines of one direction
    unequal: float = 0.67  # greatest ratio of a line's width to another's that it goes on as


LIMITS: Final = _LineLimits()


@dataclass(frozen=True)
class Lines:
    """Straight infill lines of a layer."""

    start: FloatArray  # (n, 2), mm
    end: FloatArray  # (n, 2), mm
    width_mm: FloatArray  # (n,), mm


@dataclass(frozen=True)
class Intervals:
    """Disjoint intervals on scan rows, in order of row and position."""

    row: IntArray  # (n,)
    low: FloatArray  # (n,), mm
    high: FloatArray  # (n,), mm

    def where(self, keep: NDArray[np.bool_]) -> Intervals:
        """Return those of ``keep``."""
        return Intervals(self.row[keep], self.low[keep], self.high[keep])


def infill_paths(
    contours: list[FloatArray],
    width_mm: float,
    angle_deg: float,
    origin: FloatArray,
    density: float,
) -> Paths:
    """Lines of ``width_mm`` over ``density`` of the region inside ``contours``; see `fill`.

    Lines that fill it wholly are up to `LIMITS.stretch` wider or narrower, so that a whole number
    of them fits between its lowest and its highest place across them.
    """
    if density >= 1:
        lines = fill(contours, *_fitted(contours, width_mm, angle_deg, origin))
    elif density > 0:
        lines = spaced(contours, width_mm, width_mm / density, angle_deg, origin)
    else:
        lines = fill([], width_mm, angle_deg, origin)
    return _infill(
        np.stack([lines.start, lines.end], axis=1).reshape(-1, 2),
        np.repeat(lines.width_mm, 2),
        2 * np.arange(len(lines.width_mm) + 1),
    )


def _fitted(
    contours: list[FloatArray], width_mm: float, angle_deg: float, origin: FloatArray
) -> tuple[float, float, FloatArray]:
    """Width, angle and origin for `fill`; as they are where no whole number of lines fits."""
    if not contours:
        return width_mm, angle_deg, origin
    across = _rotation(-angle_deg)[1]
    place = np.concatenate(contours) @ across
    low, high = float(place.min()), float(place.max())
    fitted = (high - low) / max(round((high - low) / width_mm), 1)
    if abs(fitted / width_mm - 1) > LIMITS.stretch:
        return width_mm, angle_deg, origin
    return fitted, angle_deg, origin + (low - float(origin @ across)) * across


def spaced(
    contours: list[FloatArray],
    width_mm: float,
    spacing_mm: float,
    angle_deg: float,
    origin: FloatArray,
) -> Lines:
    """Lines further apart than they are wide."""
    turn = _rotation(-angle_deg)
    spans = scan([(ring - origin) @ turn.T for ring in contours], spacing_mm, 0.5 * spacing_mm)
    spans = _longer(spans, LIMITS.whole * width_mm)
    height = (spans.row + 0.5) * spacing_mm
    return Lines(
        np.column_stack([spans.low, height]) @ turn + origin,
        np.column_stack([spans.high, height]) @ turn + origin,
        np.full(len(height), width_mm),
    )


def fill(
    contours: list[FloatArray], width_mm: float, angle_deg: float, origin: FloatArray
) -> Lines:
    """Fill the region inside ``contours`` (even-odd) with lines ``width_mm`` apart.

    Parameters
    ----------
    contours : list of (k, 2) float64, mm
        Closed, the last point not repeated.
    width_mm : float, mm
    angle_deg : float, °
        Direction of the lines from x.
    origin : (2,) float64, mm
        A point that an edge between two strips goes through, so that layers line up.
    """
    turn = _rotation(-angle_deg)
    turned = [(ring - origin) @ turn.T for ring in contours]
    middle = scan(turned, width_mm, 0.5 * width_mm)
    upper = scan(turned, width_mm, 0.75 * width_mm)
    lower = scan(turned, width_mm, 0.25 * width_mm)
    only_upper = _longer(subtract(upper, lower), LIMITS.half * width_mm)
    only_lower = _longer(subtract(lower, upper), LIMITS.half * width_mm)
    whole = subtract(subtract(middle, only_upper), only_lower)
    parts = [
        (_longer(whole, LIMITS.whole * width_mm), 0.5, 1.0),
        (only_upper, 0.75, 0.5),
        (only_lower, 0.25, 0.5),
    ]
    start, end, width = [], [], []
    for spans, place, part in parts:
        height = (spans.row + place) * width_mm
        start.append(np.column_stack([spans.low, height]))
        end.append(np.column_stack([spans.high, height]))
        width.append(np.full(len(height), part * width_mm))
    # points @ turn is the inverse rotation, because turn is orthogonal.
    return Lines(
        np.concatenate(start) @ turn + origin,
        np.concatenate(end) @ turn + origin,
        np.concatenate(width),
    )


def scan(contours: list[FloatArray], spacing_mm: float, first_mm: float) -> Intervals:
    """Intervals of the region (even-odd) on the rows y = first + row · spacing.

    A row that runs through a vertex counts it once: an edge covers y₀ ≤ y < y₁.
    """
    if not contours:
        return Intervals(np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
    tail = np.concatenate(contours)
    head = np.concatenate([np.roll(ring, -1, axis=0) for ring in contours])
    flip = tail[:, 1] > head[:, 1]
    low, high = np.where(flip[:, None], head, tail), np.where(flip[:, None], tail, head)
    first = np.ceil((low[:, 1] - first_mm) / spacing_mm).astype(np.int64)
    after = np.ceil((high[:, 1] - first_mm) / spacing_mm).astype(np.int64)
    count = after - first
    edge = np.repeat(np.arange(len(tail)), count)
    row = first[edge] + np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    share = (first_mm + row * spacing_mm - low[edge, 1]) / (high[edge, 1] - low[edge, 1])
    x = low[edge, 0] + share * (high[edge, 0] - low[edge, 0])
    order = np.lexsort((x, row))
    # Each row is crossed an even number of times, because every contour is closed.
    return Intervals(row[order][::2], x[order][::2], x[order][1::2])


def subtract(first: Intervals, second: Intervals) -> Intervals:
    """What is in ``first`` and not in ``second``, row by row."""
    sets = (first, second)
    row = np.concatenate([part.row for part in sets for _ in range(2)])
    place = np.concatenate([edge for part in sets for edge in (part.low, part.high)])
    kind = np.repeat([0, 0, 1, 1], [len(part.row) for part in sets for _ in range(2)])
    step = np.repeat([1, -1, 1, -1], [len(part.row) for part in sets for _ in range(2)])
    order = np.lexsort((place, row))
    row, place = row[order], place[order]
    in_first = np.cumsum(np.where(kind == 0, step, 0)[order]) > 0
    in_second = np.cumsum(np.where(kind == 1, step, 0)[order]) > 0
    keep = np.flatnonzero((in_first & ~in_second)[:-1] & (place[1:] > place[:-1]))
    return Intervals(row[keep], place[keep], place[keep + 1])


def _longer(spans: Intervals, than_mm: float) -> Intervals:
    return spans.where(spans.high - spans.low >= than_mm)


def _rotation(angle_deg: float) -> FloatArray:
    # Quarter turns exactly, so that lines along an axis have one coordinate to write.
    quarter, rest = divmod(angle_deg, 90.0)
    cosine, sine = (
        ((1, 0), (0, 1), (-1, 0), (0, -1))[int(quarter) % 4]
        if rest == 0
        else (np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg)))
    )
    return np.array([[cosine, -sine], [sine, cosine]], dtype=np.float64)


_GYROID_LENGTH: Final = 2.4574
"""Length of a gyroid's lines per area, times its period; the mean over a period of heights."""
_POINTS_PER_PERIOD: Final = 24
"""Of a gyroid's line."""


def concentric_paths(
    inside: CrossSection, width_mm: float, density: float, least: float, first_level: int
) -> Paths:
    """Rings along the region's boundary, from the outside in, ``width_mm / density`` apart.

    ``first_level`` is the number of the first ring, the walls outside it counted.
    """
    if density <= 0:
        return join([])
    if density >= 1:
        walls = build_walls(inside, width_mm, None, least).paths
        level = np.where(walls.role == Role.WALL, walls.level + first_level, 0)
        return walls._replace(level=level)
    parts: list[Paths] = []
    while True:
        inward = (0.5 + len(parts)) * width_mm / density
        centre = inside.offset(-inward, JoinType.Miter, 2.0).simplify(SLICING.collinear_mm)
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
    period = _GYROID_LENGTH * width_mm / density
    region = _polygon(inside)
    low, high = np.array(shapely.bounds(region)).reshape(2, 2) - origin
    lines = gyroid_lines(low, high, z_mm, period)
    clipped = shapely.intersection(shapely.linestrings([line + origin for line in lines]), region)
    parts = shapely.get_parts(shapely.line_merge(clipped[~shapely.is_empty(clipped)]))
    kept = [
        shapely.get_coordinates(part)
        for part in parts
        if shapely.get_type_id(part) == 1 and shapely.length(part) >= LIMITS.curved * width_mm
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
    count = int(np.ceil((high[along] - low[along]) / period_mm * _POINTS_PER_PERIOD)) + 1
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


class _Joints(NamedTuple):
    """What could join each line to the next.

    Two neighbouring lines of width w, w apart, end on a wall, a distance L from each other. Both
    are shortened by s and joined by a line of length L, v wide; s = L v / 2 w leaves the volume as
    it is. The joint is parallel to the wall's chord and v/2 inside it, as a line along it would be.
    It is half as wide as the lines: the nearer these come to the wall, the less of the corners
    beside their round ends stays empty, s³/3 w of each (0.6 % of a block with joints as wide as the
    lines). Between widths u < w both are shortened by s = L v / (u + w). Where a whole line goes on
    as a half one beside it, in the same direction, the half one begins as a ramp, long enough not
    to be merged (`_ramp`).
    """

    made: NDArray[np.bool_]  # (n - 1,)
    before: FloatArray  # (n - 1,), by how much the line is shortened, mm
    after: FloatArray  # (n - 1,), by how much the next one is, mm
    width_mm: FloatArray  # (n - 1,)


def zigzag(
    paths: Paths, sequence: WritingOrder, obstacle: Cells, joint_mm: float, least_mm: float = 0.0
) -> tuple[Paths, WritingOrder]:
    """Join straight infill lines that follow one another into zig-zags.

    Parameters
    ----------
    paths : Paths
    sequence : WritingOrder
        Infill last.
    obstacle : Cells
        Contours that no joint may cross.
    joint_mm : float, mm
        Longest joint.
    least_mm : float, mm
        Shortest move, along the longer of x and y, that the firmware doesn't merge: what is left of
        a line, and a joint, are as long.
    """
    fills = paths.role[sequence.path] == Role.INFILL
    lines = sequence.path[fills]
    if len(lines) < 2:
        return paths, sequence
    made = _joined(
        _as_written(paths, lines, sequence.backward[fills]), obstacle, joint_mm, least_mm
    )
    shift = len(paths.points)
    rest = WritingOrder(*(column[~fills] for column in sequence))
    chains = WritingOrder(
        paths.number + np.arange(made.number),
        shift + made.offset[:-1],
        np.zeros(made.number, dtype=np.bool_),
    )
    return join([paths, made]), rest.then(chains)


def _infill(points: FloatArray, width_mm: FloatArray, offset: IntArray) -> Paths:
    """Open paths in the order and the direction of writing."""
    count = len(offset) - 1
    role, level = np.full(count, int(Role.INFILL), dtype=np.int64), np.zeros(count, dtype=np.int64)
    return Paths(points, width_mm, offset, np.zeros(count, dtype=np.bool_), role, level)


def _as_written(paths: Paths, lines: IntArray, backward: NDArray[np.bool_]) -> Paths:
    low, size = paths.offset[lines], np.diff(paths.offset)[lines]
    offset = np.concatenate([[0], np.cumsum(size)])
    step = np.arange(offset[-1]) - np.repeat(offset[:-1], size)
    turned = np.repeat(backward, size)
    first = np.repeat(np.where(backward, low + size - 1, low), size)
    place = np.where(turned, first - step, first + step)
    # A width belongs to the line that comes to a point; a path's first has none.
    comes = np.where(turned & (step > 0), place + 1, place)
    return _infill(paths.points[place], paths.width_mm[comes], offset)


def _joined(lines: Paths, obstacle: Cells, joint_mm: float, least_mm: float) -> Paths:
    first, last = lines.offset[:-1], lines.offset[1:] - 1
    joints = _joints(lines, joint_mm, least_mm)
    along = _along(lines)
    begin = lines.points[last[:-1]] - joints.before[:, None] * along[:-1]
    end = lines.points[first[1:]] + joints.after[:, None] * along[1:]
    rows = np.flatnonzero(joints.made)
    made = joints.made.copy()
    made[rows[crossing(begin[rows], end[rows], obstacle)]] = False
    made = _with_room(joints, made, _length(lines), _least_left(lines, along, least_mm))
    points, width = lines.points.copy(), lines.width_mm.copy()
    points[last[:-1][made]], points[first[1:][made]] = begin[made], end[made]
    width[first[1:][made]] = joints.width_mm[made]
    return _infill(points, width, lines.offset[np.concatenate([[True], ~made, [True]])])


def _length(lines: Paths) -> FloatArray:
    way = lines.points[lines.offset[1:] - 1] - lines.points[lines.offset[:-1]]
    return np.asarray(np.hypot(way[:, 0], way[:, 1]))


def _along(lines: Paths) -> FloatArray:
    """Unit vectors from the first to the last point of each line."""
    way = lines.points[lines.offset[1:] - 1] - lines.points[lines.offset[:-1]]
    return np.asarray(way / np.maximum(_length(lines), 1e-12)[:, None])


def _least_left(lines: Paths, along: FloatArray, least_mm: float) -> FloatArray:
    """What must be left of each line: a move that isn't merged with the one after it."""
    axis = np.maximum(np.abs(along).max(axis=1), np.sqrt(0.5))
    return np.maximum(LIMITS.rest * lines.width_mm[lines.offset[1:] - 1], least_mm / axis)


def _joints(lines: Paths, joint_mm: float, least_mm: float) -> _Joints:
    """Joints between each line and the next one."""
    first, last = lines.offset[:-1], lines.offset[1:] - 1
    along, length = _along(lines), _length(lines)
    straight, width = last - first == 1, lines.width_mm[last]
    gap = lines.points[first[1:]] - lines.points[last[:-1]]
    ahead, behind = along[:-1], along[1:]
    apart = np.abs(ahead[:, 0] * gap[:, 1] - ahead[:, 1] * gap[:, 0])
    beside = np.abs((ahead * gap).sum(axis=1))
    joint = np.hypot(gap[:, 0], gap[:, 1])
    narrow, most = np.minimum(width[:-1], width[1:]), np.maximum(width[:-1], width[1:])
    wide = np.minimum(narrow, LIMITS.joint_width * width.max())
    cosine = (ahead * behind).sum(axis=1)
    near = straight[:-1] & straight[1:] & (joint <= joint_mm) & (apart > 0)
    turns = near & (cosine < -LIMITS.parallel) & (apart <= LIMITS.joint_gap * most)
    turns &= beside < np.minimum(length[:-1], length[1:])
    goes_on = near & (cosine > LIMITS.parallel) & (apart < narrow) & (beside < 1e-6 * most)
    goes_on &= narrow < LIMITS.unequal * most
    turned = wide * joint / (width[:-1] + width[1:])
    before, after = _ramp(width, apart, _least_left(lines, along, least_mm))
    return _Joints(
        turns | goes_on,
        np.where(turns, turned, before),
        np.where(turns, turned, after),
        np.where(turns, wide, narrow),
    )


def _ramp(width: FloatArray, apart: FloatArray, way: FloatArray) -> tuple[FloatArray, FloatArray]:
    """By how much two lines of one direction are shortened for a joint as the narrower one, mm.

    The joint takes ``way`` b of the narrower line, of width v, and a of the wider one, k v wide:
    k a + b = L and L² = h² + (a + b)².
    """
    thin = width[:-1] < width[1:]
    ratio = np.where(thin, width[1:] / width[:-1], width[:-1] / width[1:])
    b = np.where(thin, way[:-1], way[1:])
    more = np.maximum(ratio - 1, 1e-12)
    a = (np.sqrt((b * more) ** 2 + more * (ratio + 1) * apart**2) - b * more) / (more * (ratio + 1))
    return np.where(thin, b, a), np.where(thin, a, b)


def _with_room(
    joints: _Joints, made: NDArray[np.bool_], length: FloatArray, least: FloatArray
) -> NDArray[np.bool_]:
    """Give up joints until ``least`` is left of each line, the one after a line first."""
    made = made.copy()
    while True:
        before = np.append(np.where(made, joints.before, 0.0), 0.0)
        after = np.concatenate([[0.0], np.where(made, joints.after, 0.0)])
        short = np.flatnonzero((length - before - after < least) & (before + after > 0))
        if len(short) == 0:
            return made
        follows = np.minimum(short, len(made) - 1)
        made[np.where((short < len(made)) & made[follows], follows, short - 1)] = False
