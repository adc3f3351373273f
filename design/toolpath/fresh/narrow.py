"""Find walls too thin for any line, and gaps too narrow, within layers and along z."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from manifold3d import CrossSection
from scipy.spatial import cKDTree

from design.solids.solid import Solid
from design.toolpath.fresh.contours import Contours, contours_of, measure_room, sample
from design.toolpath.fresh.infill import scan
from design.toolpath.fresh.section import BESIDE, CLOSING_MM, Body, Layer, rings
from kernels.arrays import BoolArray, FloatArray

#: Sides face each other when the product of their normals is below this: corners aren't narrow.
FACING = -0.7
#: A narrow place is so many of the least widths long, or a tip of something broader,
SHORTEST = 4.0
#: or so much of a whole ring: a hole, a pin.
WHOLE = 0.7
#: Columns along each side of a part, at most: its z profile is sampled no finer.
MAX_COLUMNS = 400
#: Neighbouring columns of a level place differ in height by less than so much of a layer: 5°.
PARALLEL = 0.25
#: Lower places are the mesh's rounding, mm.
ROUNDING_MM = 1e-3


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
        contours = Contours(contours.points[::-1], last - contours.offset[::-1])
    if not len(contours):
        return np.empty((0, 3))
    fine = sample(contours, 0.5 * least_mm)
    room, other = measure_room(fine, 0.5 * least_mm)
    points, after = fine.contours.points, fine.contours.next
    way = points[after] - points
    length = np.hypot(*way.T)
    normal = np.column_stack([-way[:, 1], way[:, 0]]) / np.maximum(length, 1e-12)[:, None]
    near = (other >= 0) & (room < 0.5 * least_mm * (1 - 1e-3))
    narrow = near & ((fine.normal * normal[other]).sum(axis=1) < FACING)
    ring = fine.contours.ring
    whole = np.bincount(ring, near) > WHOLE * np.bincount(ring)
    run = np.cumsum(~narrow | (np.diff(ring, prepend=-1) > 0))
    long = np.bincount(run[narrow], length[narrow], minlength=run[-1] + 1) >= SHORTEST * least_mm
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
        count = np.clip(np.ceil((high - low) / line_mm), 1, MAX_COLUMNS).astype(int)
        self._levels, self._step = levels, (high - low) / count
        self._first = low + self._step / 2
        inside = _columns(solids, self._first, self._step, int(count[1]))
        same = (np.diff(inside[:, :2], axis=0) == 0).all(axis=1)
        between = np.column_stack([inside[:-1, :3], inside[1:, 2]])[same]
        between[:, 2] = inside[:-1, 3][same]
        self._walls = self._level(inside, 1 + 2 * BESIDE, ROUNDING_MM)
        closed = 2 * CLOSING_MM if len(solids) > 1 else 0.0
        self._gaps = self._level(between, 1.0, max(ROUNDING_MM, closed))
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
        first = np.searchsorted(middle, low - BESIDE * height)
        astride = np.searchsorted(middle, high + BESIDE * height) - first != 1
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
            [rows[:, :2], rows[:, 2:].mean(axis=1) / layer, height / (PARALLEL * layer)]
        )
        tree = cKDTree(places)
        whole = tree.query_ball_point(places, 1.001, p=np.inf, return_length=True) >= 9
        if not whole.any():
            return rows[:0]
        return rows[cKDTree(places[whole]).query(places, p=np.inf)[0] < 1.001]

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
