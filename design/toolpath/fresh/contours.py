"""Convert a layer's section to contour arrays with inward normals; sample points on them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from manifold3d import CrossSection
from numpy.typing import NDArray

from kernels import jit
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Contours:
    """Closed rings, the region always on their left."""

    points: FloatArray  # (n, 2), mm, the last point of a ring isn't repeated
    offset: IntArray  # (rings + 1,), ring k is ``points[offset[k] : offset[k + 1]]``

    @property
    def ring(self) -> IntArray:
        """Ring of each point, (n,)."""
        return np.repeat(np.arange(len(self.offset) - 1), np.diff(self.offset))

    @property
    def next(self) -> IntArray:
        """The point after each one on its ring, (n,)."""
        return _next(self.offset)

    @property
    def hole(self) -> NDArray[np.bool_]:
        """Whether each ring goes round a hole, (rings,)."""
        return ring_areas(self.points, self.offset) < 0

    def __len__(self) -> int:
        return len(self.offset) - 1


def _next(offset: IntArray) -> IntArray:
    after = np.arange(1, offset[-1] + 1)
    after[offset[1:] - 1] = offset[:-1]
    return after


def ring_areas(points: FloatArray, offset: IntArray) -> FloatArray:
    """Twice the signed area of each ring, (rings,), mm²; below 0 for one that runs clockwise."""
    x, y = points.T
    after = _next(offset)
    twice = np.append(x * y[after] - y * x[after], 0.0)
    return np.asarray(np.add.reduceat(twice, offset[:-1]))


def signed_area(ring: FloatArray) -> float:
    """Area of a ring (k, 2), mm²; below 0 for one that runs clockwise."""
    x, y = ring.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


@dataclass(frozen=True)
class Samples:
    """Points along contours, none further from the next than the spacing."""

    contours: Contours  # the samples themselves as rings
    # (n, 2), unit vectors into the region; at a corner halfway between its two edges'
    normal: FloatArray
    # (n,), how much further the corner of a parallel ring lies than the ring; at most 4
    miter: FloatArray
    convex: NDArray[np.bool_]  # (n,), corners that the region ends in


def contours_of(section: CrossSection) -> Contours:
    """The contours of a section, those of fewer than three points left out."""
    rings = [ring for ring in section.to_polygons() if len(ring) > 2]
    if not rings:
        return Contours(np.zeros((0, 2)), np.zeros(1, dtype=np.int64))
    offset = np.cumsum([0, *map(len, rings)], dtype=np.int64)
    return Contours(np.concatenate(rings).astype(np.float64), offset)


def sample(contours: Contours, spacing_mm: float) -> Samples:
    """Put points along every edge that is longer than ``spacing_mm``."""
    points, normal, miter, convex, offset = _sampled(contours.points, contours.offset, spacing_mm)
    return Samples(Contours(points, offset), normal, miter, convex)


@jit
def _sampled(
    corners: FloatArray, offset: IntArray, spacing: float
) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.bool_], IntArray]:
    """Points, normals, miters, convex corners (as in `Samples`), and each ring's first point."""
    along = np.empty_like(corners)
    way = np.empty_like(corners)
    pieces = np.empty(len(corners), np.int64)
    first = np.zeros(len(offset), np.int64)
    count = 0
    for ring in range(len(offset) - 1):
        for k in range(offset[ring], offset[ring + 1]):
            after = k + 1 if k + 1 < offset[ring + 1] else offset[ring]
            way[k] = corners[after] - corners[k]
            length = max(math.hypot(way[k, 0], way[k, 1]), 1e-12)
            along[k] = way[k] / length
            pieces[k] = max(math.ceil(length / spacing), 1)
            count += pieces[k]
        first[ring + 1] = count
    points, normal = np.empty((count, 2)), np.empty((count, 2))
    miter, convex = np.empty(count), np.zeros(count, np.bool_)
    at = 0
    for ring in range(len(offset) - 1):
        for k in range(offset[ring], offset[ring + 1]):
            before = k - 1 if k > offset[ring] else offset[ring + 1] - 1
            ax, ay, bx, by = along[k, 0], along[k, 1], along[before, 0], along[before, 1]
            for step in range(pieces[k]):
                share = step / pieces[k]
                points[at, 0] = corners[k, 0] + share * way[k, 0]
                points[at, 1] = corners[k, 1] + share * way[k, 1]
                x, y = ax, ay
                if step == 0:
                    size = math.hypot(ax + bx, ay + by)
                    if size > 1e-9:
                        x, y = (ax + bx) / size, (ay + by) / size
                    convex[at] = bx * ay - by * ax > 0
                else:
                    size = math.hypot(ax, ay)
                    x, y = ax / size, ay / size
                normal[at, 0], normal[at, 1] = -y, x
                miter[at] = 1 / max(abs(x * ax + y * ay), 0.25)
                at += 1
    return points, normal, miter, convex, first


class Cells(NamedTuple):
    """Edges by the square cells that their bounding boxes touch; kernels take it as it is."""

    start: FloatArray  # (n, 2), mm
    end: FloatArray  # (n, 2), mm
    low: FloatArray  # (2,), mm, corner of the first cell
    side: float  # mm
    columns: int
    rows: int
    offset: IntArray  # edges of cell k are ``edge[offset[k] : offset[k + 1]]``; cells go row by row
    edge: IntArray


def put_in_cells(contours: Contours, side_mm: float) -> Cells:
    """Sort a contour's edges into cells; edges should be short against a cell."""
    start, end = contours.points, contours.points[contours.next]
    low = start.min(axis=0)
    columns, rows = (np.floor((start.max(axis=0) - low) / side_mm) + 1).astype(np.int64).tolist()
    offset, edge = _fill_cells(start, end, low, side_mm, columns, rows)
    return Cells(start, end, low, side_mm, columns, rows, offset, edge)


@jit
def _fill_cells(
    start: FloatArray, end: FloatArray, low: FloatArray, side: float, columns: int, rows: int
) -> tuple[IntArray, IntArray]:
    first, last = np.empty((len(start), 2), np.int64), np.empty((len(start), 2), np.int64)
    for k in range(len(start)):
        for axis in range(2):
            one, other = start[k, axis], end[k, axis]
            first[k, axis] = math.floor((min(one, other) - low[axis]) / side)
            last[k, axis] = math.floor((max(one, other) - low[axis]) / side)
    offset = np.zeros(columns * rows + 1, np.int64)
    for k in range(len(first)):
        for y in range(first[k, 1], last[k, 1] + 1):
            for x in range(first[k, 0], last[k, 0] + 1):
                offset[y * columns + x + 1] += 1
    for cell in range(columns * rows):
        offset[cell + 1] += offset[cell]
    at = offset[:-1].copy()
    edge = np.empty(offset[-1], np.int64)
    for k in range(len(first)):
        for y in range(first[k, 1], last[k, 1] + 1):
            for x in range(first[k, 0], last[k, 0] + 1):
                cell = y * columns + x
                edge[at[cell]] = k
                at[cell] += 1
    return offset, edge


@jit
def _meet(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float
) -> bool:
    """Whether the segments ab and cd cross or touch."""
    c = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    d = (bx - ax) * (dy - ay) - (by - ay) * (dx - ax)
    a = (dx - cx) * (ay - cy) - (dy - cy) * (ax - cx)
    b = (dx - cx) * (by - cy) - (dy - cy) * (bx - cx)
    return c * d <= 0 and a * b <= 0


@jit
def crosses(ax: float, ay: float, bx: float, by: float, cells: Cells) -> bool:
    """Whether the way from a to b crosses an edge; looked up a cell's length at a time."""
    low, side, start, end = cells.low, cells.side, cells.start, cells.end
    steps = int(math.hypot(bx - ax, by - ay) / side) + 1
    for step in range(steps):
        px, py = ax + (bx - ax) * step / steps, ay + (by - ay) * step / steps
        qx, qy = ax + (bx - ax) * (step + 1) / steps, ay + (by - ay) * (step + 1) / steps
        x0 = max(math.floor((min(px, qx) - low[0]) / side), 0)
        x1 = min(math.floor((max(px, qx) - low[0]) / side), cells.columns - 1)
        y0 = max(math.floor((min(py, qy) - low[1]) / side), 0)
        y1 = min(math.floor((max(py, qy) - low[1]) / side), cells.rows - 1)
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                cell = y * cells.columns + x
                for place in range(cells.offset[cell], cells.offset[cell + 1]):
                    j = cells.edge[place]
                    if _meet(ax, ay, bx, by, start[j, 0], start[j, 1], end[j, 0], end[j, 1]):
                        return True
    return False


@jit
def crossing(a: FloatArray, b: FloatArray, cells: Cells) -> NDArray[np.bool_]:
    """Whether each way from a to b (n, 2) crosses an edge."""
    crossed = np.zeros(len(a), np.bool_)
    for k in range(len(a)):
        crossed[k] = crosses(a[k, 0], a[k, 1], b[k, 0], b[k, 1], cells)
    return crossed


# The disc of radius r that touches the contour at p, its centre p + r n on the inward normal n,
# touches a point q of another edge when |q - p|² = 2 r n·(q - p); r is least over all q (the
# shrinking ball of Ma et al. 2012, doi 10.1007/s00371-012-0689-8, on edges instead of points).
# Only edges that face p count, so that a corner isn't held to be a narrow place.
FACING: Final = -0.2
"""Two edges face each other when the product of their normals is below this."""


@jit
def _ball(ux: float, uy: float, vx: float, vy: float, nx: float, ny: float) -> float:
    """Radius of the disc from the origin along n that touches the edge u to u + v."""
    a, b, c = vx * vx + vy * vy, ux * vx + uy * vy, ux * ux + uy * uy
    d, e = nx * ux + ny * uy, nx * vx + ny * vy
    least = math.inf
    if d > 1e-9:
        least = c / (2 * d)
    if d + e > 1e-9:
        least = min(least, (a + 2 * b + c) / (2 * (d + e)))
    # Between the ends where the derivative vanishes: a e s² + 2 a d s = e c - 2 b d.
    places = (math.nan, math.nan)
    if abs(e) > 1e-12 * a:
        root = (a * d) ** 2 - a * e * (2 * b * d - e * c)
        if root >= 0:
            root = math.sqrt(root)
            places = ((-a * d + root) / (a * e), (-a * d - root) / (a * e))
    elif d > 1e-9:
        places = (-b / a, math.nan)
    for s in places:
        if 0 < s < 1 and d + e * s > 1e-9:
            least = min(least, (a * s * s + 2 * b * s + c) / (2 * (d + e * s)))
    return least


@jit
def _room(
    points: FloatArray, normal: FloatArray, cells: Cells, most: float
) -> tuple[FloatArray, IntArray]:
    low, side, start, end = cells.low, cells.side, cells.start, cells.end
    radius = np.full(len(points), most)
    other = np.full(len(points), -1, np.int64)
    for k in range(len(points)):
        px, py = points[k, 0], points[k, 1]
        nx, ny = normal[k, 0], normal[k, 1]
        # The disc of the largest radius lies in this box.
        x0 = max(int((px + most * nx - most - low[0]) / side), 0)
        x1 = min(int((px + most * nx + most - low[0]) / side), cells.columns - 1)
        y0 = max(int((py + most * ny - most - low[1]) / side), 0)
        y1 = min(int((py + most * ny + most - low[1]) / side), cells.rows - 1)
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                cell = y * cells.columns + x
                for place in range(cells.offset[cell], cells.offset[cell + 1]):
                    j = cells.edge[place]
                    vx, vy = end[j, 0] - start[j, 0], end[j, 1] - start[j, 1]
                    length = math.sqrt(vx * vx + vy * vy)
                    if length < 1e-12 or (-vy * nx + vx * ny) > FACING * length:
                        continue
                    ball = _ball(start[j, 0] - px, start[j, 1] - py, vx, vy, nx, ny)
                    if ball < radius[k]:
                        radius[k] = ball
                        other[k] = j
    return radius, other


def measure_room(samples: Samples, most_mm: float) -> tuple[FloatArray, IntArray]:
    """Radius of the largest disc at each sample, and the edge that it touches on the other side.

    Parameters
    ----------
    samples : Samples
        Sampled more densely than ``most_mm``.
    most_mm : float, mm
        Larger discs aren't looked for.

    Returns
    -------
    radius : (n,) float64, mm
        At most ``most_mm``.
    other : (n,) int64
        Edge, by the sample it begins at; -1 where the disc is of the largest radius.
    """
    if len(samples.normal) == 0:
        return np.zeros(0), np.zeros(0, dtype=np.int64)
    cells = put_in_cells(samples.contours, 2 * most_mm)
    return _room(samples.contours.points, samples.normal, cells, most_mm)
