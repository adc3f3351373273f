"""Convert a layer's ordered paths to moves, with links, hops, retractions between them.

Between two paths the needle goes level where they are near and no lumen lies between (a link);
else the plunger is relieved and the needle hops, just clear of the fresh ink, or rises higher
where it would cross an open lumen, and primes when it is down again. Beside a lumen it primes and
relieves a little way into the material, so that what weeps doesn't stand in the lumen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.toolpath.fresh.contours import Cells, Contours, crossing, put_in_cells, sample
from design.toolpath.fresh.options import FreshOptions
from design.toolpath.fresh.order import Sequence
from design.toolpath.fresh.paths import Paths, Role
from design.toolpath.toolpath import MoveKind
from kernels import jit
from kernels.arrays import FloatArray, IntArray

_WRITE, _TRAVEL = int(MoveKind.WRITE), int(MoveKind.TRAVEL)
_PRIME, _RETRACT = int(MoveKind.PRIME), int(MoveKind.RETRACT)

#: Contours are looked up in cells of so many line widths.
CELL = 4.0


@dataclass(frozen=True)
class Rows:
    """Moves of one layer as arrays.

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


class Care(NamedTuple):
    """Numbers of `FreshOptions` that the kernels need: mm, mm/s, µL and µL/s."""

    z: float
    height: float
    link: float
    hop: float
    lift: float
    relief: float
    flow: float
    writing: float
    level: float
    rising: float


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
    near = crossing(np.vstack([tip[:2], ends[:-1]]), starts, here)
    came = np.vstack([tip[:2], away[:-1]])
    over = crossing(came, lead, here)
    over[:1] |= crossing(came[:1], lead[:1], below)
    care = Care(
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
        over,
        tip,
        care,
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
    free = ~crossing(starts[rows], inside, here)
    lead[rows[free]] = inside[free]
    return lead


@jit
def _add(
    rows: FloatArray,
    kind: IntArray,
    n: int,
    what: int,
    x: float,
    y: float,
    z: float,
    volume: float,
    speed: float,
    duration: float,
) -> int:
    rows[n, 0], rows[n, 1], rows[n, 2] = x, y, z
    rows[n, 3], rows[n, 4], rows[n, 5] = volume, speed, duration
    kind[n] = what
    return n + 1


@jit
def _fly(
    rows: FloatArray,
    kind: IntArray,
    n: int,
    x: float,
    y: float,
    tip_z: float,
    to_x: float,
    to_y: float,
    rise: float,
    care: Care,
) -> int:
    """Relieve, go up by ``rise`` above both ends, across and down, and prime."""
    pause, top = care.relief / care.flow, max(tip_z, care.z) + rise
    if care.relief > 0:
        n = _add(rows, kind, n, _RETRACT, x, y, tip_z, -care.relief, 0.0, pause)
    if top != tip_z:
        n = _add(rows, kind, n, _TRAVEL, x, y, top, 0.0, care.rising, 0.0)
    if to_x != x or to_y != y:
        n = _add(rows, kind, n, _TRAVEL, to_x, to_y, top, 0.0, care.level, 0.0)
    if top != care.z:
        n = _add(rows, kind, n, _TRAVEL, to_x, to_y, care.z, 0.0, care.rising, 0.0)
    if care.relief > 0:
        n = _add(rows, kind, n, _PRIME, to_x, to_y, care.z, care.relief, 0.0, pause)
    return n


@jit
def _lay(
    points: FloatArray,
    width: FloatArray,
    offset: IntArray,
    closed: NDArray[np.bool_],
    path: IntArray,
    first: IntArray,
    backward: NDArray[np.bool_],
    lead: FloatArray,
    away: FloatArray,
    near: NDArray[np.bool_],
    over: NDArray[np.bool_],
    tip: FloatArray,
    care: Care,
) -> tuple[FloatArray, IntArray, IntArray]:
    """Rows of end, volume, speed and duration; kinds; travels, those lifted, and links."""
    most = len(points) + 10 * len(path) + 1
    rows, kind = np.zeros((most, 6)), np.zeros(most, np.int64)
    counts = np.zeros(3, np.int64)
    n, z, level = 0, care.z, care.level
    x, y, tip_z = tip[0], tip[1], tip[2]
    for k in range(len(path)):
        p = path[k]
        begin, low, size = first[k], offset[p], offset[p + 1] - offset[p]
        to_x, to_y = points[begin, 0], points[begin, 1]
        far = math.hypot(to_x - x, to_y - y)
        if far > 0 or tip_z != z:
            counts[0] += 1
            if far <= care.link and tip_z == z and not near[k]:
                counts[2] += 1
                n = _add(rows, kind, n, _TRAVEL, to_x, to_y, z, 0.0, level, 0.0)
            else:
                counts[1] += over[k]
                if k > 0 and (away[k - 1, 0] != x or away[k - 1, 1] != y):
                    x, y = away[k - 1, 0], away[k - 1, 1]
                    n = _add(rows, kind, n, _TRAVEL, x, y, tip_z, 0.0, level, 0.0)
                in_x, in_y = lead[k, 0], lead[k, 1]
                rise = care.lift if over[k] else care.hop
                n = _fly(rows, kind, n, x, y, tip_z, in_x, in_y, rise, care)
                if in_x != to_x or in_y != to_y:
                    n = _add(rows, kind, n, _TRAVEL, to_x, to_y, z, 0.0, level, 0.0)
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
                volume = wide * care.height * length
                n = _add(rows, kind, n, _WRITE, x, y, z, volume, care.writing, 0.0)
    last = len(path) - 1
    if last >= 0 and (away[last, 0] != x or away[last, 1] != y):
        n = _add(rows, kind, n, _TRAVEL, away[last, 0], away[last, 1], z, 0.0, level, 0.0)
    return rows[:n].copy(), kind[:n].copy(), counts
