"""A layer's paths, laid end to end with the travels between them, as rows of moves.

Between two paths the needle goes level where they are near and no lumen lies between (a link);
else the plunger is relieved and the needle hops, just clear of the fresh ink, or rises higher
where it would cross an open lumen, and primes when it is down again. Beside a lumen it primes and
relieves a little way into the material, so that what weeps doesn't stand in the lumen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from design.toolpath.fresh.contours import Contours, sample
from design.toolpath.fresh.options import FreshOptions
from design.toolpath.fresh.order import Sequence
from design.toolpath.fresh.paths import Paths, Role
from design.toolpath.fresh.room import Cells, put_in_cells
from design.toolpath.toolpath import FloatArray, IntArray, MoveKind
from kernels import jit

_WRITE, _TRAVEL = int(MoveKind.WRITE), int(MoveKind.TRAVEL)
_PRIME, _RETRACT = int(MoveKind.PRIME), int(MoveKind.RETRACT)

#: Contours are looked up in cells of so many line widths.
CELL = 4.0


@dataclass(frozen=True)
class Rows:
    """Moves of one layer.

    Attributes
    ----------
    end : (n, 3) float64, mm
    volume_ul, speed_mm_s, duration_s : (n,) float64
        As in `Toolpath`.
    kind : (n,) int64
    travels, lifted, links : int
        As in `FreshReport`.
    """

    end: FloatArray
    volume_ul: FloatArray
    speed_mm_s: FloatArray
    duration_s: FloatArray
    kind: IntArray
    travels: int
    lifted: int
    links: int


def obstacles(contours: Contours, width_mm: float) -> Cells:
    """A layer's contours, to ask what crosses them."""
    return put_in_cells(sample(contours, CELL * width_mm).contours, CELL * width_mm)


def lay_out(
    paths: Paths,
    sequence: Sequence,
    tip: FloatArray,
    height_mm: float,
    obstacle: tuple[Cells, Cells],
    options: FreshOptions,
) -> Rows:
    """Lay ``paths`` in their order.

    Parameters
    ----------
    paths : Paths
    sequence : Sequence
    tip : (3,) float64, mm
        Where the needle is.
    height_mm : float, mm
        Of the tip in this layer.
    obstacle : (Cells, Cells)
        The layer's contours, and those of the layer that the needle comes from.
    options : FreshOptions
    """
    here, below = obstacle
    starts, ends = _ends(paths, sequence)
    lead = _leads(paths, sequence, starts, here, options.lead_mm)
    away = np.where((lead == starts).all(axis=1)[:, None], ends, lead)
    near = _crossing(np.vstack([tip[:2], ends[:-1]]), starts, *_spread(here))
    came = np.vstack([tip[:2], away[:-1]])
    crossing = _crossing(came, lead, *_spread(here))
    crossing[:1] |= _crossing(came[:1], lead[:1], *_spread(below))
    numbers = np.array(
        [
            height_mm,
            options.layer_height_mm,
            options.link_mm,
            options.hop_mm,
            options.lift_mm,
            options.retract_ul,
            options.plunger_ul_s,
            options.write_speed_mm_s,
            options.travel_speed_mm_s,
            options.lift_speed_mm_s,
        ]
    )
    rows, kind, counts = _lay(
        paths.points,
        paths.width_mm,
        paths.offset,
        paths.closed,
        sequence.path,
        sequence.first,
        sequence.backward,
        lead,
        away,
        near,
        crossing,
        tip,
        numbers,
    )
    return Rows(rows[:, :3], rows[:, 3], rows[:, 4], rows[:, 5], kind, *map(int, counts))


def _ends(paths: Paths, sequence: Sequence) -> tuple[FloatArray, FloatArray]:
    """First and last point of each path as it is written."""
    low, high = paths.offset[sequence.path], paths.offset[sequence.path + 1] - 1
    last = np.where(sequence.backward, low, high)
    last = np.where(paths.closed[sequence.path], sequence.first, last)
    return paths.points[sequence.first], paths.points[last]


def _leads(
    paths: Paths, sequence: Sequence, starts: FloatArray, here: Cells, lead_mm: float
) -> FloatArray:
    """Where the plunger primes for each path: beside the walls of lumens, else at its start."""
    lead = starts.copy()
    closed = paths.closed[sequence.path] & (paths.role[sequence.path] == Role.WALL)
    rows = np.flatnonzero(closed & (paths.level[sequence.path] == 0))
    if lead_mm == 0 or len(rows) == 0:
        return lead
    first = sequence.first[rows]
    low, high = paths.offset[sequence.path[rows]], paths.offset[sequence.path[rows] + 1]
    before = np.where(first > low, first - 1, high - 1)
    after = np.where(first < high - 1, first + 1, low)
    way = paths.points[after] - paths.points[before]
    size = np.hypot(way[:, 0], way[:, 1])
    left = np.column_stack([-way[:, 1], way[:, 0]]) / np.maximum(size, 1e-12)[:, None]
    inside = starts[rows] + lead_mm * left
    free = ~_crossing(starts[rows], inside, *_spread(here))
    lead[rows[free]] = inside[free]
    return lead


def _spread(
    cells: Cells,
) -> tuple[FloatArray, FloatArray, FloatArray, float, int, int, IntArray, IntArray]:
    return (
        cells.start,
        cells.end,
        cells.low,
        cells.side,
        cells.columns,
        cells.rows,
        cells.offset,
        cells.edge,
    )


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
def _crossing(
    a: FloatArray,
    b: FloatArray,
    start: FloatArray,
    end: FloatArray,
    low: FloatArray,
    side: float,
    columns: int,
    rows: int,
    offset: IntArray,
    edge: IntArray,
) -> np.ndarray:
    """Whether each way from a to b crosses an edge; looked up a cell's length at a time."""
    found = np.zeros(len(a), np.bool_)
    for k in range(len(a)):
        ax, ay, bx, by = a[k, 0], a[k, 1], b[k, 0], b[k, 1]
        steps = int(math.hypot(bx - ax, by - ay) / side) + 1
        for step in range(steps):
            px, py = ax + (bx - ax) * step / steps, ay + (by - ay) * step / steps
            qx, qy = ax + (bx - ax) * (step + 1) / steps, ay + (by - ay) * (step + 1) / steps
            x0 = max(math.floor((min(px, qx) - low[0]) / side), 0)
            x1 = min(math.floor((max(px, qx) - low[0]) / side), columns - 1)
            y0 = max(math.floor((min(py, qy) - low[1]) / side), 0)
            y1 = min(math.floor((max(py, qy) - low[1]) / side), rows - 1)
            for y in range(y0, y1 + 1):
                for x in range(x0, x1 + 1):
                    cell = y * columns + x
                    for place in range(offset[cell], offset[cell + 1]):
                        j = edge[place]
                        if _meet(ax, ay, bx, by, start[j, 0], start[j, 1], end[j, 0], end[j, 1]):
                            found[k] = True
                            break
                    if found[k]:
                        break
                if found[k]:
                    break
            if found[k]:
                break
    return found


@jit
def _lay(
    points: FloatArray,
    width: FloatArray,
    offset: IntArray,
    closed: np.ndarray,
    path: IntArray,
    first: IntArray,
    backward: np.ndarray,
    lead: FloatArray,
    away: FloatArray,
    near: np.ndarray,
    crossing: np.ndarray,
    tip: FloatArray,
    numbers: FloatArray,
) -> tuple[FloatArray, IntArray, IntArray]:
    z, height, link, hop, lift = numbers[0], numbers[1], numbers[2], numbers[3], numbers[4]
    relief, flow, writing, level, rising = (
        numbers[5],
        numbers[6],
        numbers[7],
        numbers[8],
        numbers[9],
    )
    most = len(points) + 10 * len(path) + 1
    rows, kind = np.zeros((most, 6)), np.zeros(most, np.int64)
    counts = np.zeros(3, np.int64)
    n = 0
    x, y, tip_z = tip[0], tip[1], tip[2]
    for k in range(len(path)):
        p = path[k]
        begin, low, size = first[k], offset[p], offset[p + 1] - offset[p]
        to_x, to_y = points[begin, 0], points[begin, 1]
        far = math.hypot(to_x - x, to_y - y)
        if far > 0 or tip_z != z:
            counts[0] += 1
            if far <= link and tip_z == z and not near[k]:
                counts[2] += 1
                rows[n, 0], rows[n, 1], rows[n, 2], rows[n, 4] = to_x, to_y, z, level
                kind[n] = _TRAVEL
                n += 1
            else:
                counts[1] += crossing[k]
                if k > 0 and (away[k - 1, 0] != x or away[k - 1, 1] != y):
                    x, y = away[k - 1, 0], away[k - 1, 1]
                    rows[n, 0], rows[n, 1], rows[n, 2], rows[n, 4] = x, y, tip_z, level
                    kind[n] = _TRAVEL
                    n += 1
                in_x, in_y = lead[k, 0], lead[k, 1]
                far = math.hypot(in_x - x, in_y - y)
                if relief > 0:
                    rows[n, 0], rows[n, 1], rows[n, 2] = x, y, tip_z
                    rows[n, 3], rows[n, 5], kind[n] = -relief, relief / flow, _RETRACT
                    n += 1
                top = max(tip_z, z) + (lift if crossing[k] else hop)
                if top != tip_z:
                    rows[n, 0], rows[n, 1], rows[n, 2], rows[n, 4] = x, y, top, rising
                    kind[n] = _TRAVEL
                    n += 1
                if far > 0:
                    rows[n, 0], rows[n, 1], rows[n, 2], rows[n, 4] = in_x, in_y, top, level
                    kind[n] = _TRAVEL
                    n += 1
                if top != z:
                    rows[n, 0], rows[n, 1], rows[n, 2], rows[n, 4] = in_x, in_y, z, rising
                    kind[n] = _TRAVEL
                    n += 1
                if relief > 0:
                    rows[n, 0], rows[n, 1], rows[n, 2] = in_x, in_y, z
                    rows[n, 3], rows[n, 5], kind[n] = relief, relief / flow, _PRIME
                    n += 1
                if in_x != to_x or in_y != to_y:
                    rows[n, 0], rows[n, 1], rows[n, 2], rows[n, 4] = to_x, to_y, z, level
                    kind[n] = _TRAVEL
                    n += 1
        x, y, tip_z = to_x, to_y, z
        for step in range(1, size + 1 if closed[p] else size):
            if closed[p]:
                i = low + (begin - low + step) % size
                wide = width[i]
            elif backward[k]:
                i = begin - step
                wide = width[i + 1]
            else:
                i = begin + step
                wide = width[i]
            length = math.hypot(points[i, 0] - x, points[i, 1] - y)
            if length > 0:
                x, y = points[i, 0], points[i, 1]
                rows[n, 0], rows[n, 1], rows[n, 2] = x, y, z
                rows[n, 3], rows[n, 4], kind[n] = wide * height * length, writing, _WRITE
                n += 1
    last = len(path) - 1
    if last >= 0 and (away[last, 0] != x or away[last, 1] != y):
        rows[n, 0], rows[n, 1], rows[n, 2] = away[last, 0], away[last, 1], z
        rows[n, 4], kind[n] = level, _TRAVEL
        n += 1
    return rows[:n].copy(), kind[:n].copy(), counts
