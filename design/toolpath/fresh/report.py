"""Add up lengths, ink volumes, travels and coverage of FRESH layers for the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from manifold3d import CrossSection

from design.solids.solid import Solid
from design.toolpath.fresh.contours import Contours, contours_of, measure_room, sample
from design.toolpath.fresh.coverage import Coverage
from design.toolpath.fresh.infill import scan
from design.toolpath.fresh.layout import LayerMoves
from design.toolpath.fresh.section import SLICING, Body, Layer, rings
from design.toolpath.toolpath import MoveKind, Toolpath
from kernels.arrays import BoolArray, FloatArray, IntArray


class _NarrowLimits(NamedTuple):
    """What counts as a narrow place."""

    facing: float = -0.7  # sides face each other below this product of normals: corners don't
    length: float = 4.0  # of a place, in least widths, or else it is a tip of something broader,
    whole: float = 0.7  # or so much of a whole ring: a hole, a pin
    columns: int = 400  # along each side of a part, at most: its z profile is sampled no finer
    beside: float = 1.001  # neighbouring columns, and heights, differ by at most so much
    slope: float = 0.25  # of a layer, between neighbouring columns of a level place: 5°
    rounding_mm: float = 1e-3  # lower places are the mesh's rounding


NARROW: Final = _NarrowLimits()


@dataclass(frozen=True)
class NarrowPlaces:
    """Places that are narrower than lines can make.

    Attributes
    ----------
    least_mm : float, mm
        Least width that lines make.
    width_mm : float, mm
        Median of what the places have.
    at_mm : (x, y, z), mm
        One of that width, in the part's frame.
    layers : float
        Part of the layers looked at that have such places.
    area_mm2 : float or None, mm²
        In plan, of places between level faces: their width is along z. None within layers.
    """

    least_mm: float
    width_mm: float
    at_mm: tuple[float, float, float]
    layers: float
    area_mm2: float | None = None


def narrow_samples(section: CrossSection, least_mm: float, *, gaps: bool) -> FloatArray:
    """Places along a section's contours where it, or a gap in it, is narrower than ``least_mm``.

    Returns
    -------
    (n, 3) float64, mm
        Width, x, y.
    """
    contours = contours_of(section)
    if gaps:
        last = contours.offset[-1]
        contours = Contours(contours.points[::-1].copy(), last - contours.offset[::-1])
    if not len(contours):
        return np.empty((0, 3))
    fine = sample(contours, 0.5 * least_mm)
    room, other = measure_room(fine, 0.5 * least_mm)
    points, after = fine.contours.points, fine.contours.next
    way = points[after] - points
    length = np.hypot(*way.T)
    normal = np.column_stack([-way[:, 1], way[:, 0]]) / np.maximum(length, 1e-12)[:, None]
    near = (other >= 0) & (room < 0.5 * least_mm * (1 - 1e-3))
    narrow = near & ((fine.normal * normal[other]).sum(axis=1) < NARROW.facing)
    ring = fine.contours.ring
    whole = np.bincount(ring, near) > NARROW.whole * np.bincount(ring)
    run = np.cumsum(~narrow | (np.diff(ring, prepend=-1) > 0))
    long = (
        np.bincount(run[narrow], length[narrow], minlength=run[-1] + 1) >= NARROW.length * least_mm
    )
    narrow = (narrow & long[run]) | (near & whole[ring])
    middle = points[narrow] + room[narrow, None] * fine.normal[narrow]
    return np.column_stack([2 * room[narrow], middle])


def narrow_places(
    samples: Sequence[FloatArray], z_mm: Sequence[float], least_mm: float
) -> NarrowPlaces | None:
    """Sum up what `narrow_samples` found in layers at the heights ``z_mm``; None for nothing."""
    heights = np.repeat(np.asarray(z_mm), [len(one) for one in samples])
    if not len(heights):
        return None
    rows = np.column_stack([np.concatenate(samples), heights])
    width, *at = rows[np.argsort(rows[:, 0], kind="stable")[(len(rows) - 1) // 2]].tolist()
    share = float(np.mean([len(one) > 0 for one in samples]))
    return NarrowPlaces(least_mm, width, (at[0], at[1], at[2]), share)


class LevelPlaces:
    """Walls and gaps between level faces that are lower than whole layers make them.

    The part is sampled in upright columns about a line apart. A place counts where all columns of
    a square of three have it, about equally high: poles of spheres, sides of lying lumens and
    sharp edges don't.

    Parameters
    ----------
    solids : sequence of Solid
    levels : (n + 1,) float64, mm
        Borders of the layers.
    line_mm : float, mm
    """

    def __init__(self, solids: Sequence[Solid], levels: FloatArray, line_mm: float) -> None:
        corners = np.array([solid.bounds[:, :2] for solid in solids])
        low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
        count = np.clip(np.ceil((high - low) / line_mm), 1, NARROW.columns).astype(int)
        self._levels, self._step = levels, (high - low) / count
        self._first = low + self._step / 2
        inside = _columns(solids, self._first, self._step, int(count[1]))
        same = (np.diff(inside[:, :2], axis=0) == 0).all(axis=1)
        between = np.column_stack([inside[:-1, :3], inside[1:, 2]])[same]
        between[:, 2] = inside[:-1, 3][same]
        self._walls = self._level(inside, 1 + 2 * SLICING.beside, NARROW.rounding_mm)
        closed = 2 * SLICING.closing_mm if len(solids) > 1 else 0.0
        self._gaps = self._level(between, 1.0, max(NARROW.rounding_mm, closed))
        self._in_material, self._written = np.zeros((2, len(self._walls)), dtype=np.bool_)

    def add(self, layer: Layer) -> None:
        """Note which walls a layer meets, and in which lines may be written."""
        low, high = self._walls[:, 2:].T
        here = np.flatnonzero((low < layer.middle_mm + 1e-4) & (high > layer.middle_mm - 1e-4))
        for section, met in ((layer.material, self._in_material), (layer.carved, self._written)):
            if len(here):
                met[here] |= self._inside(section, self._walls[here])

    @property
    def lost_ul(self) -> float:
        """Volume of the walls between the layers' sections, µL."""
        height = np.diff(self._walls[:, 2:])[:, 0]
        return float(height[~self._in_material].sum() * self._step.prod())

    @property
    def gap_ul(self) -> float:
        """Volume of the gaps, µL; of those that no section meets, the sections count it in."""
        return float(np.diff(self._gaps[:, 2:]).sum() * self._step.prod())

    def walls(self) -> NarrowPlaces | None:
        """Walls lower than a layer, or in which none is written."""
        height = np.diff(self._walls[:, 2:])[:, 0]
        low = height < 0.99 * self._heights(self._walls)
        return self._places(self._walls[low | ~self._written])

    def gaps(self) -> NarrowPlaces | None:
        """Gaps lower than a layer, or of one layer's height astride of two."""
        height = self._heights(self._gaps)
        low, high = self._gaps[:, 2:].T
        middle = 0.5 * (self._levels[1:] + self._levels[:-1])
        first = np.searchsorted(middle, low - SLICING.beside * height)
        astride = np.searchsorted(middle, high + SLICING.beside * height) - first != 1
        return self._places(self._gaps[(high - low < 0.99 * height) | astride])

    def _heights(self, rows: FloatArray) -> FloatArray:
        """Heights of the layers at the rows' middles."""
        layer = np.searchsorted(self._levels, rows[:, 2:].mean(axis=1)) - 1
        return np.diff(self._levels)[np.clip(layer, 0, len(self._levels) - 2)]

    def _level(self, rows: FloatArray, most: float, least_mm: float) -> FloatArray:
        """Rows no higher than ``most`` layers that lie in a level place."""
        height = np.diff(rows[:, 2:])[:, 0]
        rows = rows[(height <= 1.001 * most * self._heights(rows)) & (height > least_mm)]
        if not len(rows):
            return rows
        layer, height = self._heights(rows), np.diff(rows[:, 2:])[:, 0]
        places = np.column_stack(
            [rows[:, :2], rows[:, 2:].mean(axis=1) / layer, height / (NARROW.slope * layer)]
        )
        whole = _neighbours(places, places) >= 9
        return rows[_neighbours(places, places[whole]) > 0]

    def _inside(self, section: CrossSection, rows: FloatArray) -> BoolArray:
        """Whether a section holds the columns of rows."""
        outline = [ring - self._first for ring in rings(section)]
        spans = scan(outline, float(self._step[1]), 0.0)
        if not len(spans.row):
            return np.zeros(len(rows), dtype=np.bool_)
        x, far = rows[:, 0] * self._step[0], 1e4  # mm, beyond any part
        span = np.searchsorted(spans.row * far + spans.low, rows[:, 1] * far + x, "right") - 1
        found: BoolArray = (span >= 0) & (spans.row[span] == rows[:, 1]) & (x <= spans.high[span])
        return found

    def _places(self, rows: FloatArray) -> NarrowPlaces | None:
        if not len(rows):
            return None
        height = np.diff(rows[:, 2:])[:, 0]
        at = int(np.argsort(height, kind="stable")[(len(rows) - 1) // 2])
        x, y = (self._first + rows[at, :2] * self._step).tolist()
        layers = np.unique(np.searchsorted(self._levels, rows[:, 2:].mean(axis=1)))
        return NarrowPlaces(
            float(self._heights(rows)[at]),
            float(height[at]),
            (x, y, float(rows[at, 2:].mean())),
            len(layers) / (len(self._levels) - 1),
            float(len(rows) * self._step.prod()),
        )


def _neighbours(places: FloatArray, others: FloatArray) -> IntArray:
    """How many of ``others`` (m, 4) each place (n, 4) has about 1 away, in any coordinate, or less.

    The first two coordinates are a grid's. SciPy's tree would take 0.2 CPU s to load.
    """
    rows = int(places[:, 1].max(initial=0.0)) + 3
    column = others[:, 0] * rows + others[:, 1]
    order = np.argsort(column, kind="stable")
    column, others = column[order], others[order]
    count = np.zeros(len(places), np.int64)
    for x, y in product((-1, 0, 1), repeat=2):
        beside = (places[:, 0] + x) * rows + places[:, 1] + y
        at, after = np.searchsorted(column, beside), np.searchsorted(column, beside, "right")
        while len(left := np.flatnonzero(at < after)):
            apart = np.abs(others[at[left], 2:] - places[left, 2:])
            count[left] += (apart <= NARROW.beside).all(axis=1)
            at = at + 1
    return count


def _columns(
    solids: Sequence[Solid], first: FloatArray, step: FloatArray, count: int
) -> FloatArray:
    """Material of upright columns: column along x and y, lowest and highest z, mm; (n, 4)."""
    # Turned so that sections are upright and their rows columns: (z, x) at each y.
    turned = Body([replace(one, vertices=one.vertices[:, [2, 0, 1]]) for one in solids])
    found = [np.empty((0, 4))]
    for k in range(count):
        section = rings(turned.slice(float(first[1] + k * step[1])))
        spans = scan([ring - (0.0, first[0]) for ring in section], float(step[0]), 0.0)
        along_y = np.full(len(spans.row), k)
        found.append(np.column_stack([spans.row, along_y, spans.low, spans.high]))
    return np.concatenate(found)


LEAST_OVERLAP: Final = 1e-3
"""Of the part's volume: what bodies may have in common before it is told."""


@dataclass(frozen=True)
class FreshReport:
    """Figures of a plan of FRESH layers.

    Attributes
    ----------
    layers, lines : int
        Layers with material, and written paths in them.
    written_mm, travel_mm : float, mm
    written_ul_of_heads : tuple of float, µL
        Ink of the lines that each head wrote.
    changes : int
        Changes of head.
    written_ul, material_ul : float, µL
        Ink of the lines, and the layers' sections times their heights.
    part_ul, unfilled_ul : float, µL
        Volume of the part itself, and what of it no line covers: in the layers, as those measured
        have it, and between them.
    unfilled : (k,) float64
        Part of a layer's material that no line covers, in the layers where it was measured.
    outside : (k,) float64
        Area that lines cover outside the material, as a part of the layer's material: rounded
        corners never, lines wider than the place they stand in always.
    thin_walls, narrow_gaps : NarrowPlaces or None
        In the layers whose cover was measured.
    low_walls, low_gaps : NarrowPlaces or None
        Between level faces, of a height that whole layers don't make; their width is that height.
    overlap_ul : float, µL
        Volume that bodies of one mesh have in common.
    travels : int
        Travels between paths, links included.
    lifted : int
        Of these, the ones that would have crossed an open lumen and went above it.
    links : int
        Of these, the ones so short that they go without retraction.
    """

    layers: int
    lines: int
    written_mm: float
    travel_mm: float
    written_ul: float
    material_ul: float
    unfilled: FloatArray
    outside: FloatArray
    travels: int
    lifted: int
    links: int
    changes: int
    written_ul_of_heads: tuple[float, ...]
    part_ul: float
    unfilled_ul: float
    thin_walls: NarrowPlaces | None = None
    narrow_gaps: NarrowPlaces | None = None
    low_walls: NarrowPlaces | None = None
    low_gaps: NarrowPlaces | None = None
    overlap_ul: float = 0.0

    @property
    def overlap_notes(self) -> tuple[str, ...]:
        """What bodies of the part have in common, in words; nothing where that is next to none."""
        if self.overlap_ul <= LEAST_OVERLAP * self.part_ul:
            return ()
        return (
            f"bodies of one mesh overlap or occur twice ({self.overlap_ul:.4g} µL in common): they "
            "are printed as one; if one of them belongs elsewhere, move it in the model and export "
            "it again",
        )

    @property
    def narrow_notes(self) -> tuple[str, ...]:
        """What lines can't make of the part, in words."""
        kinds = (
            (self.thin_walls, "walls", "no line is written in them"),
            (self.narrow_gaps, "gaps", "the lines beside them may close them"),
            (self.low_walls, "level walls", "a whole layer is written in them, or none"),
            (self.low_gaps, "level gaps", "layers close them, or leave a whole layer or two open"),
        )
        return tuple(
            _narrow_note(places, what, end) for places, what, end in kinds if places is not None
        )

    @property
    def unfilled_fraction(self) -> float:
        """Part of the part's own volume that no line covers."""
        return self.unfilled_ul / self.part_ul


def _narrow_note(places: NarrowPlaces, what: str, end: str) -> str:
    x, y, z = places.at_mm
    least = f"{places.least_mm:.3g} mm"
    if what.startswith("level"):
        size, extent = "high", f"over {places.area_mm2:.3g} mm² in all"
        least = (
            f"these layers make is {least}, from one border of layers to the next, and "
            f"{(1 + 2 * SLICING.beside) * places.least_mm:.3g} mm elsewhere: make them higher, or "
            "write lower layers"
        )
    else:
        size, extent = "wide", f"in {places.layers:.0%} of the layers"
        least = f"these lines make is {least}: make them wider, or write narrower lines"
    return (
        f"{what} about {places.width_mm:.3g} mm {size}, as at x {x:.4g}, y {y:.4g}, z {z:.4g} mm "
        f"of the part, {extent}: {end}; the least that {least}"
    )


@dataclass(frozen=True)
class LayerNarrow:
    """Narrow places of one layer, as `narrow_samples`, and the least that lines make, mm."""

    z_mm: float
    walls: FloatArray
    gaps: FloatArray
    least_wall_mm: float
    least_gap_mm: float


class Tally:
    """Adds up a part's numbers, layer by layer."""

    def __init__(self, part_ul: float, overlap_ul: float, level_places: LevelPlaces) -> None:
        self.moves = 0
        self._part_ul, self._overlap_ul, self._level_places = part_ul, overlap_ul, level_places
        self._layers = self._lines = self._travels = self._lifted = self._links = 0
        self._written_mm = self._travel_mm = self._material_ul = 0.0
        self._changes = 0
        self._written_ul = np.zeros(1)
        self._coverage: list[Coverage] = []
        self._measured_mm: list[float] = []
        self._narrow: list[LayerNarrow] = []

    def add(self, toolpath: Toolpath, laid: LayerMoves, lines: int) -> None:
        """Count the moves of one layer."""
        length, wrote = toolpath.lengths, toolpath.kind == MoveKind.WRITE
        self.moves += len(toolpath)
        self._lines += lines
        self._travels += laid.travels
        self._lifted += laid.lifted
        self._links += laid.links
        self._changes += laid.changes
        self._written_mm += float(length[wrote].sum())
        self._travel_mm += float(length[toolpath.kind == MoveKind.TRAVEL].sum())
        # By the lines alone: a head that is left stays relieved.
        most = int(toolpath.tool.max(initial=0)) + 1
        ink = np.zeros(max(most, len(self._written_ul)))
        ink[: len(self._written_ul)] = self._written_ul
        np.add.at(ink, toolpath.tool[wrote], toolpath.volume_ul[wrote])
        self._written_ul = ink

    def add_layer(
        self, layer: Layer, coverage: Coverage | None, narrow: LayerNarrow | None = None
    ) -> None:
        """Count a layer with material, and how well its lines cover it where that was measured."""
        self._narrow += [] if narrow is None else [narrow]
        self._layers += 1
        self._level_places.add(layer)
        self._material_ul += layer.material.area() * layer.height_mm
        if coverage is not None:
            self._coverage.append(coverage)
            self._measured_mm.append(layer.height_mm)

    def report(self) -> FreshReport:
        """Return the numbers of the layers so far."""
        material = np.array([layer.material for layer in self._coverage])
        unfilled = np.array([layer.unfilled for layer in self._coverage])
        share = np.dot(unfilled, self._measured_mm) / np.dot(material, self._measured_mm)
        lost = max(self._level_places.lost_ul, self._part_ul - self._material_ul, 0.0)
        gaps = np.clip(self._material_ul - self._part_ul, 0.0, self._level_places.gap_ul)
        return FreshReport(
            layers=self._layers,
            lines=self._lines,
            written_mm=self._written_mm,
            travel_mm=self._travel_mm,
            written_ul=float(self._written_ul.sum()),
            material_ul=self._material_ul,
            part_ul=self._part_ul,
            overlap_ul=self._overlap_ul,
            unfilled_ul=max(float(share * self._material_ul + lost - gaps), 0.0),
            unfilled=unfilled / material,
            outside=np.array([layer.outside for layer in self._coverage]) / material,
            travels=self._travels,
            lifted=self._lifted,
            links=self._links,
            changes=self._changes,
            written_ul_of_heads=tuple(self._written_ul.tolist()),
            thin_walls=self._places(gaps=False),
            narrow_gaps=self._places(gaps=True),
            low_walls=self._level_places.walls(),
            low_gaps=self._level_places.gaps(),
        )

    def _places(self, *, gaps: bool) -> NarrowPlaces | None:
        if not self._narrow:
            return None
        samples = [one.gaps if gaps else one.walls for one in self._narrow]
        least = self._narrow[0].least_gap_mm if gaps else self._narrow[0].least_wall_mm
        return narrow_places(samples, [one.z_mm for one in self._narrow], least)
