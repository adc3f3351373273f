"""Convert a layer's ordered paths to moves, with links, hops, retractions between them.

Between two paths the needle goes level where they are near and no lumen lies between (a link);
else the plunger is relieved and the needle hops, just clear of the fresh ink, and primes when it
is down again. Where it would cross an open lumen it goes around, or rises higher where that takes
less time. Beside a lumen it primes and relieves a little way into the material, so that what weeps
doesn't stand in the lumen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from manifold3d import CrossSection

from design.toolpath.fresh.contours import (
    Cells,
    Contours,
    contours_of,
    crosses,
    crossing,
    put_in_cells,
    sample,
)
from design.toolpath.fresh.infill import zigzag
from design.toolpath.fresh.options import FreshOptions
from design.toolpath.fresh.paths import Paths, Role, WritingOrder, order_paths
from design.toolpath.toolpath import MoveKind
from kernels import jit
from kernels.arrays import BoolArray, FloatArray, IntArray

_WRITE, _TRAVEL = int(MoveKind.WRITE), int(MoveKind.TRAVEL)
_PRIME, _RETRACT = int(MoveKind.PRIME), int(MoveKind.RETRACT)

CELL_WIDTHS: Final = 4.0
"""Contours are looked up in cells of so many line widths."""


class LayerMoves(NamedTuple):
    """Moves of one FRESH layer, or of one head's section of it."""

    start: FloatArray  # (3,), mm, where the first of them begins
    end: FloatArray  # (n, 3), mm
    volume_ul: FloatArray  # (n,), as in `Toolpath`
    speed_mm_s: FloatArray  # (n,)
    duration_s: FloatArray  # (n,)
    kind: IntArray  # (n,)
    tool: IntArray  # (n,)
    travels: int = 0  # these four as in `FreshReport`
    lifted: int = 0
    links: int = 0
    changes: int = 0  # one before the layer included

    def where(self, rows: BoolArray) -> LayerMoves:
        """Only some of the moves, by a mask."""
        columns = [column[rows] for column in self[1:7]]
        return LayerMoves._make([self.start, *columns, *self[7:]])

    @staticmethod
    def joined(parts: Sequence[LayerMoves]) -> LayerMoves:
        """Moves one after another."""
        start, *rest = zip(*parts, strict=True)
        columns = [np.concatenate(column) for column in rest[:6]]
        return LayerMoves._make([start[0], *columns, *map(sum, rest[6:])])


class _Ways(NamedTuple):
    """Ways to paths in their order."""

    lead: FloatArray  # (m, 2), where the plunger primes before a path, mm
    away: FloatArray  # (m, 2), where it relieves after it, mm
    blocked: BoolArray  # (m,), whether a link from the path before would cross a contour
    over: BoolArray  # (m,), whether the way from where that was left does
    around: FloatArray  # (m, 2, 2), points of a way that doesn't, mm; NaN where there is none


class _Settings(NamedTuple):
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
    """Sort a layer's contours into cells, to ask what crosses them."""
    cell_mm = CELL_WIDTHS * width_mm
    return put_in_cells(sample(contours, cell_mm).contours, cell_mm)


def lay_out(
    paths: Paths,
    sequence: WritingOrder,
    tip: FloatArray,
    height_mm: float,
    obstacle: tuple[Cells, Cells],
    options: FreshOptions,
    head: int = 0,
) -> LayerMoves:
    """Lay ``paths`` in their order.

    Parameters
    ----------
    paths : Paths
    sequence : WritingOrder
    tip : (3,) float64, mm
        Where the needle is.
    height_mm : float, mm
        Of the tip in this layer.
    obstacle : (Cells, Cells)
        The layer's contours, and those of the layer that the needle comes from.
    options : FreshOptions
    head : int
        That makes the moves.
    """
    here, below = obstacle
    starts, ends = _ends(paths, sequence)
    lead = _leads(paths, sequence, starts, here, options.lead_mm)
    away = np.where((lead == starts).all(axis=1)[:, None], ends, lead)
    blocked = crossing(np.vstack([tip[:2], ends[:-1]]), starts, here)
    came = np.vstack([tip[:2], away[:-1]])
    over = crossing(came, lead, here)
    over[:1] |= crossing(came[:1], lead[:1], below)
    settings = _Settings(
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
    # A higher rise takes its time, in which the needle could go so far level.
    rising_mm = 2 * max(options.lift_mm - options.hop_mm, 0.0)
    most_mm = rising_mm * options.travel_speed_mm_s / options.lift_speed_mm_s
    level = over & (np.arange(len(over)) > 0)  # the first comes from another layer
    around = _around(came, lead, level, most_mm, here)
    over &= np.isnan(around).any(axis=(1, 2))
    ways = _Ways(lead, away, blocked, over, around)
    rows, kind, counts = _lay(paths, sequence, ways, tip, settings)
    tool = np.full(len(kind), head)
    columns = rows[:, :3], rows[:, 3], rows[:, 4], rows[:, 5], kind, tool
    return LayerMoves(tip, *columns, *map(int, counts))


def _ends(paths: Paths, sequence: WritingOrder) -> tuple[FloatArray, FloatArray]:
    """First and last point of each path as it is written."""
    low, high = paths.offset[sequence.path], paths.offset[sequence.path + 1] - 1
    last = np.where(sequence.backward, low, high)
    last = np.where(paths.closed[sequence.path], sequence.first, last)
    return paths.points[sequence.first], paths.points[last]


def _leads(
    paths: Paths, sequence: WritingOrder, starts: FloatArray, here: Cells, lead_mm: float
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


_SIDEWAYS_MM: Final = (0.3, 0.45, 0.6, 0.9, 1.2, 1.8, 2.4, 3.6)
"""How far aside of the straight way its points are tried."""
_ALONG: Final = ((0.5, 0.5), (0.25, 0.25), (0.75, 0.75), (0.0, 1.0), (0.2, 0.8), (0.35, 0.65))
"""Where along the straight way the two points are tried, in parts of it."""


@jit
def _around(
    start: FloatArray, end: FloatArray, which: BoolArray, most_mm: float, here: Cells
) -> FloatArray:
    """Shortest of the tried ways over two points that crosses no contour; (m, 2, 2), NaN for none.

    No way is more than `most_mm` longer than the straight one.
    """
    found = np.full((len(start), 2, 2), np.nan)
    for k in np.flatnonzero(which):
        ax, ay, bx, by = start[k, 0], start[k, 1], end[k, 0], end[k, 1]
        dx, dy = bx - ax, by - ay
        straight = math.hypot(dx, dy)
        least = straight + most_mm
        for aside in _SIDEWAYS_MM:
            for side in (-aside / straight, aside / straight):
                for first, last in _ALONG:
                    px, py = ax + first * dx - side * dy, ay + first * dy + side * dx
                    qx, qy = ax + last * dx - side * dy, ay + last * dy + side * dx
                    length = math.hypot(px - ax, py - ay) + math.hypot(bx - qx, by - qy)
                    length += (last - first) * straight
                    if length >= least or crosses(ax, ay, px, py, here):
                        continue
                    if not (crosses(px, py, qx, qy, here) or crosses(qx, qy, bx, by, here)):
                        least = length
                        found[k, 0, 0], found[k, 0, 1] = px, py
                        found[k, 1, 0], found[k, 1, 1] = qx, qy
    return found


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
    around: FloatArray,
    rise: float,
    settings: _Settings,
) -> int:
    """Relieve, go up by ``rise`` above both ends, across or around, and down, and prime."""
    pause, top = settings.relief / settings.flow, max(tip_z, settings.z) + rise
    if settings.relief > 0:
        n = _add(rows, kind, n, _RETRACT, x, y, tip_z, -settings.relief, 0.0, pause)
    if top != tip_z:
        n = _add(rows, kind, n, _TRAVEL, x, y, top, 0.0, settings.rising, 0.0)
    for k in range(3):
        on_x, on_y = (around[k, 0], around[k, 1]) if k < 2 else (to_x, to_y)
        if not math.isnan(on_x) and (on_x != x or on_y != y):
            x, y = on_x, on_y
            n = _add(rows, kind, n, _TRAVEL, x, y, top, 0.0, settings.level, 0.0)
    if top != settings.z:
        n = _add(rows, kind, n, _TRAVEL, to_x, to_y, settings.z, 0.0, settings.rising, 0.0)
    if settings.relief > 0:
        n = _add(rows, kind, n, _PRIME, to_x, to_y, settings.z, settings.relief, 0.0, pause)
    return n


@jit
def _lay(
    paths: Paths, sequence: WritingOrder, ways: _Ways, tip: FloatArray, settings: _Settings
) -> tuple[FloatArray, IntArray, IntArray]:
    """Rows of end, volume, speed and duration; kinds; travels, those lifted, and links."""
    points, width, offset, closed = paths.points, paths.width_mm, paths.offset, paths.closed
    path, first, backward = sequence.path, sequence.first, sequence.backward
    lead, away, over = ways.lead, ways.away, ways.over
    most = len(points) + 12 * len(path) + 1
    rows, kind = np.zeros((most, 6)), np.zeros(most, np.int64)
    counts = np.zeros(3, np.int64)
    n, z, level = 0, settings.z, settings.level
    x, y, tip_z = tip[0], tip[1], tip[2]
    for k in range(len(path)):
        p = path[k]
        begin, low, size = first[k], offset[p], offset[p + 1] - offset[p]
        to_x, to_y = points[begin, 0], points[begin, 1]
        far = math.hypot(to_x - x, to_y - y)
        if far > 0 or tip_z != z:
            counts[0] += 1
            if far <= settings.link and tip_z == z and not ways.blocked[k]:
                counts[2] += 1
                n = _add(rows, kind, n, _TRAVEL, to_x, to_y, z, 0.0, level, 0.0)
            else:
                counts[1] += over[k]
                if k > 0 and (away[k - 1, 0] != x or away[k - 1, 1] != y):
                    x, y = away[k - 1, 0], away[k - 1, 1]
                    n = _add(rows, kind, n, _TRAVEL, x, y, tip_z, 0.0, level, 0.0)
                in_x, in_y = lead[k, 0], lead[k, 1]
                rise = settings.lift if over[k] else settings.hop
                n = _fly(rows, kind, n, x, y, tip_z, in_x, in_y, ways.around[k], rise, settings)
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
                volume = wide * settings.height * length
                n = _add(rows, kind, n, _WRITE, x, y, z, volume, settings.writing, 0.0)
    last = len(path) - 1
    if last >= 0 and (away[last, 0] != x or away[last, 1] != y):
        n = _add(rows, kind, n, _TRAVEL, away[last, 0], away[last, 1], z, 0.0, level, 0.0)
    return rows[:n].copy(), kind[:n].copy(), counts


# In a layer the head in use writes first, then the others: a layer costs as many changes as it has
# other heads. What is done at a change is the G-code writer's (up, raise, choose, lower, across,
# down); the toolpath says where the old head relieves and the new one primes, and both do it beside
# a lumen's wall in their own material, as for any other way.
SEAM_TURN: Final = np.pi * (3 - np.sqrt(5))
"""From layer to layer, rad: the golden angle, which spreads any number of seams evenly."""


@dataclass(frozen=True)
class Section:
    """What one head writes in a layer."""

    head: int
    paths: Paths
    bounds: CrossSection  # of its material: a way that leaves it is lifted, and is never a link


class Carriage:
    """Writes sections one after the other, from where the last one ended.

    Parameters
    ----------
    heads : sequence of FreshOptions
        Each head's own.
    corner : (2,) float64, mm
        Near which the first line is looked for.
    """

    def __init__(self, heads: Sequence[FreshOptions], corner: FloatArray) -> None:
        self._heads = list(heads)
        self._corner = corner
        self._tip: FloatArray | None = None
        self._below: Cells | None = None
        self._active = 0
        self._used: set[int] = set()
        self._layers = 0

    def write(self, sections: Sequence[Section], tip_mm: float, height_mm: float) -> LayerMoves:
        """Lay sections of a layer with the tip at ``tip_mm``, the one of the head in use first."""
        self._heads = [one.in_layer(height_mm) for one in self._heads]
        self._layers += 1
        order = sorted(sections, key=lambda one: (one.head != self._active, one.head))
        parts = [self._section(section, tip_mm) for section in order]
        if parts:
            return LayerMoves.joined(parts)
        start = np.append(self._corner, tip_mm) if self._tip is None else self._tip
        none, nothing = np.zeros(0), np.zeros(0, dtype=np.int64)
        return LayerMoves(start, np.zeros((0, 3)), none, none, none, nothing, nothing)

    def _section(self, section: Section, z: float) -> LayerMoves:
        options, paths = self._heads[section.head], section.paths
        here = obstacles(contours_of(section.bounds), options.line_width_mm)
        at = self._corner if self._tip is None else self._tip[:2]
        sequence = order_paths(paths, at, options.link_mm, SEAM_TURN * self._layers)
        paths, sequence = zigzag(paths, sequence, here, options.joint_mm, options.least_move_mm)
        if paths.number and self._tip is None:
            self._tip = np.append(paths.points[sequence.first[0]], z)
            self._active = section.head
        start = np.append(at, z) if self._tip is None else self._tip
        changes = paths.number > 0 and section.head != self._active
        came = start
        if changes and start[2] == z:
            # From any lower place no way is a link: heads don't change on a level way.
            came = np.array([*start[:2], np.nextafter(z, -np.inf)])
        around = here, self._below or here
        moves = lay_out(paths, sequence, came, z, around, options, section.head)
        moves = moves._replace(start=start)
        if changes:
            moves = self._handed_over(moves)
        if len(moves.end):
            self._tip, self._active = moves.end[-1], section.head
            self._used.add(section.head)
        self._below = here
        return moves

    def _handed_over(self, moves: LayerMoves) -> LayerMoves:
        """Moves of a new head, relieved of the old one first.

        A head that hasn't written yet has nothing to prime: nothing was relieved in it.
        """
        new, old = int(moves.tool[0]), self._heads[self._active]
        before = np.arange(len(moves.kind)) < np.flatnonzero(moves.kind == MoveKind.WRITE)[0]
        gone = before & (moves.kind == MoveKind.RETRACT)
        if new not in self._used:
            gone |= before & (moves.kind == MoveKind.PRIME)
        rest = moves.where(~gone)._replace(changes=1)
        if old.retract_ul == 0:
            return rest
        lasts = np.array([old.retract_ul / old.plunger_ul_s])
        volume, kind = np.array([-old.retract_ul]), np.array([int(MoveKind.RETRACT)])
        tool = np.array([self._active])
        relieved = LayerMoves(
            moves.start, moves.start[None], volume, np.zeros(1), lasts, kind, tool
        )
        return LayerMoves.joined([relieved, rest])
