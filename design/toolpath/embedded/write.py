"""Convert ordered writing strokes to toolpath moves: end overlaps, lowest safe travels."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from design.geometry.polyline import places_along
from design.toolpath.embedded.elements import (
    CUTTING,
    Elements,
    finer_places,
    nearest_along,
    off_chords,
)
from design.toolpath.embedded.needle import EmbeddedHeads, frustum_ul, writing_speed
from design.toolpath.embedded.order.schedule import Leg, Pass
from design.toolpath.embedded.report import JoinedPasses
from design.toolpath.toolpath import ARRAYS, MoveBuilder, MoveKind, Toolpath
from kernels import jit
from kernels.arrays import FloatArray, IntArray

RADIUS_STEP: Final = 1.5
"""Where a pass goes on into a vessel by so much thinner or thicker, the plunger relieves and primes
in place: the pressure that drives a thick filament takes its way to fall, and would swell the thin
one behind it. A smaller step swells the first half millimetre by 27 % at most
(`gcode.deposit.lay`)."""
ROUNDING_MM: Final = 1e-6
"""What ends so near to a vessel's end ends there."""


@dataclass(frozen=True)
class Stretch:
    """Part of one vessel as it is written: points (k, 3), radii and way along it (k,), mm."""

    points: FloatArray
    radius: FloatArray
    along: FloatArray
    vessel: int


class FilamentWriter:
    """Converts embedded passes to moves.

    Parameters
    ----------
    elements : Elements
    first : Pass
    heads : EmbeddedHeads
    looks : set of int
        Elements before which the path names a place to look.

    Attributes
    ----------
    builder : MoveBuilder
        Where the moves go.
    overlap_ul : float, µL
        Ink of the overlaps.
    """

    def __init__(
        self,
        elements: Elements,
        first: Pass,
        heads: EmbeddedHeads,
        looks: Set[int] = frozenset(),
    ) -> None:
        self._looks = looks
        self._elements, self._heads = elements, heads
        leg = first.legs[0]
        self._head = heads.of(int(elements.vessel[leg.element]))
        self._options = heads.options[self._head]
        start = elements.point[elements.end[leg.element, 0 if leg.step > 0 else 1]]
        self.builder = MoveBuilder(start, "vessel")
        self.builder.tool = self._head
        self.overlap_ul = 0.0
        self._vessels: list[int] = []
        self._along: list[FloatArray] = []
        self._radius: list[FloatArray] = []
        self._pressed: set[int] = set()
        self._started = False
        self._ground: Ground = ground_under(
            elements.point, heads.shaft_mm, float(elements.radius.max())
        )

    def write_all(self, passes: list[Pass], joined: JoinedPasses) -> None:
        """Write passes in their order."""
        for one, before, beyond in zip(passes, joined.before, joined.beyond, strict=True):
            parts = [part for leg in one.legs for part in self._parts(leg)]
            looks = {k for k, part in enumerate(parts) if part.element in self._looks}
            stretches = [self._stretch(part) for part in parts]
            self._write(stretches, float(before), float(beyond), looks)

    def laid(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Vessel (w,), way along it and radius at both ends (w, 2), of each move that writes."""
        counts = [len(one) for one in self._along]
        vessel = np.repeat(np.array(self._vessels, dtype=np.int64), counts)
        return vessel, np.concatenate(self._along), np.concatenate(self._radius)

    def _parts(self, leg: Leg) -> list[Leg]:
        """A leg cut where the path names a place to look."""
        cuts = [k for k, one in enumerate(leg.elements().tolist()) if k and one in self._looks]
        return [
            Leg(leg.element + leg.step * low, leg.step, high - low)
            for low, high in pairwise([0, *cuts, leg.size])
        ]

    def _stretch(self, leg: Leg) -> Stretch:
        """A leg as few straight moves as its shape and taper need."""
        order = leg.elements()
        side = (0, 1) if leg.step > 0 else (1, 0)
        ends, radius = self._elements.end[order], self._elements.radius[order]
        numbers = np.append(ends[:, side[0]], ends[-1, side[1]])
        thick = np.append(radius[:, side[0]], radius[-1, side[1]])
        way = self._elements.along[order]
        along = np.append(way[:, side[0]], way[-1, side[1]])
        points = self._elements.point[numbers]
        values = np.column_stack([points, thick, along])
        values = values[off_chords(np.ascontiguousarray(values[:, :4]))]
        place = finer_places(values[:, :3], values[:, 3], np.inf, CUTTING.taper_step)
        values = places_along(values, np.arange(len(values), dtype=np.float64), place)
        points, (thick, along) = values[:, :3].copy(), values[:, 3:].T.copy()
        return Stretch(points, thick, along, int(self._elements.vessel[leg.element]))

    def _write(
        self, stretches: list[Stretch], before: float, beyond: float, looks: Set[int]
    ) -> None:
        if before > 0.0:
            stretches[0] = self._longer(stretches[0], before, at_end=False)
        if beyond > 0.0:
            stretches[-1] = self._longer(stretches[-1], beyond, at_end=True)
        first = stretches[0]
        self._go(first.points[0], first.vessel, self._heads.of(first.vessel))
        for number, one in enumerate(stretches):
            if number in looks:
                self.builder.look(one.vessel)
            if number and _is_step(stretches[number - 1], one):
                self._settle(one.vessel)
            length = np.linalg.norm(np.diff(one.points, axis=0), axis=1)
            volume = frustum_ul(one.points, one.radius)
            speed = writing_speed(volume / length, self._options)
            self.builder.write(one.points[1:], volume, speed, one.vessel)
            self._vessels.append(one.vessel)
            self._along.append(np.column_stack([one.along[:-1], one.along[1:]]))
            self._radius.append(np.column_stack([one.radius[:-1], one.radius[1:]]))
            lay(self._ground, one.points, one.radius, self._heads.shaft_mm)
        self._pressed.add(self._head)

    def _settle(self, vessel: int) -> None:
        """Relieve the plunger, and prime it again, without leaving the place."""
        options = self._options
        self.builder.plunge(-options.retract_ul, options.plunger_ul_s, vessel)
        self.builder.plunge(options.retract_ul, options.plunger_ul_s, vessel)
        self.builder.dwell(options.dwell_s, vessel)

    def _longer(self, one: Stretch, reach_mm: float, *, at_end: bool) -> Stretch:
        """Go on straight beyond an end, as thick as there.

        Beyond the vessel's own end the way counts on. Where the pass was cut within the vessel it
        is that of what is nearest on the axis, from which a bend leads away.
        """
        end, inner = (-1, -2) if at_end else (0, 1)
        way = one.points[end] - one.points[inner]
        further = one.points[end] + reach_mm * way / np.linalg.norm(way)
        place = len(one.points) if at_end else 0
        rises = one.along[end] > one.along[inner]
        along = one.along[end] + (reach_mm if rises else -reach_mm)
        whole = self._elements.along[self._elements.first[one.vessel + 1] - 1, 1]
        if ROUNDING_MM < one.along[end] < whole - ROUNDING_MM:
            along = nearest_along(self._elements, one.vessel, further)
        self.overlap_ul += float(np.pi * one.radius[end] ** 2 * reach_mm)
        return Stretch(
            np.insert(one.points, place, further, axis=0),
            np.insert(one.radius, place, one.radius[end]),
            np.insert(one.along, place, along),
            one.vessel,
        )

    def _go(self, to: FloatArray, vessel: int, head: int) -> None:
        """Retract, rise above what stands in the way, cross, go down, prime.

        With another head from the way across on; one that has pushed nothing yet isn't primed.
        Close to ink the needle goes slowly up and down, elsewhere as fast as across.
        """
        options, builder = self._options, self.builder
        if self._started:
            builder.plunge(-options.retract_ul, options.plunger_ul_s, vessel)
            tip, changes = builder.tip, head != self._head
            below = float(self._ground.top.max()) if changes else self._highest(tip, to)
            height = max(below, tip[2], to[2]) + options.lift_mm
            up, across = np.array([*tip[:2], height]), np.array([*to[:2], height])
            self._vertically(tip, up, vessel)
            self._head = builder.tool = head
            options = self._options = self._heads.options[head]
            if np.any(across != up):
                builder.travel(across[None], options.travel_speed_mm_s, vessel)
            self._vertically(across, to, vessel)
            if head in self._pressed:
                builder.plunge(options.retract_ul, options.plunger_ul_s, vessel)
        else:
            # The job begins here: before the first point, where an overlap asks for it.
            builder = self.builder = MoveBuilder(to, "vessel")
            builder.tool = self._head
        self._started = True
        builder.dwell(options.dwell_s, vessel)

    def _highest(self, tip: FloatArray, to: FloatArray) -> float:
        return float(highest_along(self._ground, tip, to))

    def _vertically(self, start: FloatArray, end: FloatArray, vessel: int) -> None:
        """Up or down: slowly below the ink that stands around, and a lift above it."""
        options = self._options
        low, high = sorted((float(start[2]), float(end[2])))
        slow = max(self._highest(start, start), low) + options.lift_mm
        fast_speed = max(options.travel_speed_mm_s, options.lift_speed_mm_s)
        if low < slow < high:
            between = np.array([*start[:2], slow])
            up = end[2] > start[2]
            speeds = [options.lift_speed_mm_s, fast_speed] if up else [
                fast_speed, options.lift_speed_mm_s,
            ]  # fmt: skip
            self.builder.travel(np.stack([between, end]), speeds, vessel)
        elif np.any(start != end):
            speed = options.lift_speed_mm_s if slow >= high else fast_speed
            self.builder.travel(end[None], speed, vessel)


def _is_step(one: Stretch, other: Stretch) -> bool:
    thin, thick = sorted((float(one.radius[-1]), float(other.radius[0])))
    return thick > RADIUS_STEP * thin


MAX_CELLS: Final = 4_000_000
"""Of the map; a larger part gets coarser cells."""


class Ground(NamedTuple):
    """Highest ink that a needle would touch with its tip over each cell, mm; -inf over none."""

    origin: FloatArray  # (2,), mm
    cell_mm: float
    top: FloatArray  # (nx, ny), mm


def ground_under(points: FloatArray, shaft_mm: float, thickest_mm: float) -> Ground:
    """A map over (n, 3) points with nothing on it, in cells of a third of the shaft's radius."""
    room = shaft_mm + thickest_mm + shaft_mm
    low, high = points[:, :2].min(axis=0) - room, points[:, :2].max(axis=0) + room
    cell = max(shaft_mm / 3.0, float(np.sqrt((high - low).prod() / MAX_CELLS)))
    shape = np.ceil((high - low) / cell).astype(np.int64) + 1
    return Ground(low, cell, np.full(shape, -np.inf))


@jit
def lay(ground: Ground, points: FloatArray, radius: FloatArray, shaft: float) -> None:
    """Note a filament along (k, 3) points of radii (k,)."""
    for k in range(len(points) - 1):
        a, b = points[k], points[k + 1]
        thick = max(radius[k], radius[k + 1])
        # Cells are told by their middles: half a diagonal more is sure.
        reach = shaft + thick + 0.71 * ground.cell_mm
        low_x, high_x = _cells(min(a[0], b[0]) - reach, max(a[0], b[0]) + reach, ground, 0)
        low_y, high_y = _cells(min(a[1], b[1]) - reach, max(a[1], b[1]) + reach, ground, 1)
        dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        length2 = dx * dx + dy * dy
        for i in range(low_x, high_x):
            x = ground.origin[0] + (i + 0.5) * ground.cell_mm
            for j in range(low_y, high_y):
                y = ground.origin[1] + (j + 0.5) * ground.cell_mm
                t = ((x - a[0]) * dx + (y - a[1]) * dy) / length2 if length2 > 0.0 else 0.0
                t = min(max(t, 0.0), 1.0)
                ox, oy = a[0] + t * dx - x, a[1] + t * dy - y
                if ox * ox + oy * oy < reach * reach:
                    # Within reach it may be higher than here, but not than its upper end.
                    slope = abs(dz) / np.sqrt(length2) if length2 > 0.0 else np.inf
                    high = min(max(a[2], b[2]), a[2] + t * dz + slope * reach)
                    ground.top[i, j] = max(ground.top[i, j], high + thick)


@jit
def highest_along(ground: Ground, start: FloatArray, end: FloatArray) -> float:
    """Highest ink under a straight way in the plan, mm; -inf over none."""
    way = np.hypot(end[0] - start[0], end[1] - start[1])
    count = int(np.ceil(2.0 * way / ground.cell_mm)) + 1
    top = -np.inf
    for k in range(count + 1):
        t = k / count
        x = start[0] + t * (end[0] - start[0])
        y = start[1] + t * (end[1] - start[1])
        low_x, high_x = _cells(x - ground.cell_mm / 2.0, x + ground.cell_mm / 2.0, ground, 0)
        low_y, high_y = _cells(y - ground.cell_mm / 2.0, y + ground.cell_mm / 2.0, ground, 1)
        for i in range(low_x, high_x):
            for j in range(low_y, high_y):
                top = max(top, ground.top[i, j])
    return float(top)


@jit
def _cells(low: float, high: float, ground: Ground, axis: int) -> tuple[int, int]:
    """First cell and one past the last that a stretch of an axis meets."""
    count = ground.top.shape[axis]
    first = int(np.floor((low - ground.origin[axis]) / ground.cell_mm))
    last = int(np.floor((high - ground.origin[axis]) / ground.cell_mm)) + 1
    return min(max(first, 0), count), min(max(last, 0), count)


# A needle that moves through a yield-stress bath leaves a crevice, which closes within a time of
# the bath's own. Ink written into an open one runs up along it. So before a pass the needle waits,
# above what it is to write, until every place of the pass has been left by the shaft for that time.
SAMPLES_PER_RADIUS: Final = 2.0
"""Places looked at for each radius of the shaft along a move."""


def add_recovery_dwells(toolpath: Toolpath, recovery_s: float, radius_mm: float) -> Toolpath:
    """The toolpath with dwells before the descents to passes in a fresh wake.

    Parameters
    ----------
    toolpath : Toolpath
        Of passes, between which the needle travels.
    recovery_s : float, s
        How long the bath takes to close.
    radius_mm : float, mm
        Of the widest shaft.
    """
    if recovery_s <= 0:
        return toolpath
    lasts = toolpath.duration_s + _moving_s(toolpath)
    begins = np.concatenate([[0.0], np.cumsum(lasts)[:-1]])
    places, moves, when = _sampled(toolpath, begins, lasts, radius_mm / SAMPLES_PER_RADIUS)
    rows: list[int] = []
    waits: list[float] = []
    late = 0.0
    for last, first, end in _passes(toolpath):
        row = _descent(toolpath, last, first)
        begin, done, stop = np.searchsorted(moves, [row, first, end])
        when[begin:stop] += late  # the descent itself belongs to the pass
        oldest = np.searchsorted(when[:begin], when[done] - recovery_s)
        age = _age(places, when, slice(done, stop), slice(oldest, begin), radius_mm)
        if age < recovery_s:
            rows.append(row)
            waits.append(recovery_s - age)
            late += recovery_s - age
            when[begin:stop] += recovery_s - age
    return _with_dwells(toolpath, np.array(rows, dtype=np.int64), np.array(waits))


def _moving_s(toolpath: Toolpath) -> FloatArray:
    moves = toolpath.speed_mm_s > 0
    seconds = np.zeros(len(toolpath))
    seconds[moves] = toolpath.lengths[moves] / toolpath.speed_mm_s[moves]
    return seconds


def _sampled(
    toolpath: Toolpath, begins: FloatArray, lasts: FloatArray, step_mm: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Places of the tip (n, 3), the move of each, and when it is there, s."""
    count = np.maximum(np.ceil(toolpath.lengths / step_mm).astype(np.int64), 1) + 1
    moves = np.repeat(np.arange(len(toolpath)), count)
    share = np.arange(len(moves)) - np.repeat(np.cumsum(count) - count, count)
    share = share / (count[moves] - 1)
    way = toolpath.end - toolpath.start
    places = toolpath.start[moves] + share[:, None] * way[moves]
    return places, moves, begins[moves] + share * lasts[moves]


def _passes(toolpath: Toolpath) -> list[tuple[int, int, int]]:
    """Of each pass but the first: last move of the one before, its first, and the move after it."""
    writes = np.flatnonzero(toolpath.kind == MoveKind.WRITE)
    travels = np.concatenate([[0], np.cumsum(toolpath.kind == MoveKind.TRAVEL)])
    breaks = np.flatnonzero(np.diff(travels[writes]) > 0)
    firsts = writes[breaks + 1].tolist()
    ends = [*writes[breaks[1:]].tolist(), int(writes[-1])] if len(breaks) else []
    return [
        (int(writes[at]), first, end + 1)
        for at, first, end in zip(breaks.tolist(), firsts, ends, strict=True)
    ]


def _age(
    places: FloatArray, when: FloatArray, own: slice, before: slice, radius_mm: float
) -> float:
    """How long before its own writing the shaft last stood in a place of the pass, at least, s."""
    mine, others = places[own], places[before]
    away = np.hypot(mine[:, None, 0] - others[None, :, 0], mine[:, None, 1] - others[None, :, 1])
    swept = (away < radius_mm) & (others[None, :, 2] < mine[:, None, 2] + radius_mm)
    ages = when[own][:, None] - when[before][None]
    return float(np.where(swept, ages, np.inf).min(initial=np.inf))


def _descent(toolpath: Toolpath, last: int, first: int) -> int:
    """The move before which to wait: the first of those that go straight down to the pass."""
    row = first
    while row - 1 > last:
        way = toolpath.end[row - 1] - toolpath.start[row - 1]
        still = toolpath.kind[row - 1] != MoveKind.TRAVEL
        if not still and (way[2] >= 0 or way[:2].any()):
            break
        row -= 1
    return row


def _with_dwells(toolpath: Toolpath, rows: IntArray, waits: FloatArray) -> Toolpath:
    """Insert a dwell before each of the moves ``rows``."""
    if not len(rows):
        return toolpath
    moves, nothing = toolpath.where(rows), np.zeros(len(rows))
    dwells = replace(
        moves,
        end=moves.start,
        volume_ul=nothing,
        speed_mm_s=nothing,
        duration_s=waits,
        kind=np.full(len(rows), int(MoveKind.DWELL)),
    )
    both = {name: (getattr(toolpath, name), getattr(dwells, name)) for name in ARRAYS}
    return replace(
        toolpath,
        **{name: np.insert(all_, rows, more, axis=0) for name, (all_, more) in both.items()},
    )
