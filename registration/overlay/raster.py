"""Rasterise a G-code layer: its lines, covered pixels, lumens and patches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, find_objects, label
from shapely import Polygon, contains_xy, prepare

from design.solids.solid import Solid
from design.toolpath.correction import Stretch
from design.toolpath.fresh.section import manifold_of, rings
from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.gcode_job import Act, GcodeJob


@dataclass(frozen=True, eq=False)
class PixelPatch:
    """A connected patch of pixels.

    Attributes
    ----------
    area_mm2 : float, mm²
    width_mm : float, mm
        Diameter of the largest circle within it.
    at_mm : (float, float), mm
        Middle of that circle, x and y, part frame; within the patch, however bent it is.
    low_mm, high_mm : (float, float), mm
        Its bounding box.
    box : (slice, slice)
        Rows and columns of the raster that hold it.
    mask : bool
        Its pixels within the box.
    """

    area_mm2: float
    width_mm: float
    at_mm: tuple[float, float]
    low_mm: tuple[float, float]
    high_mm: tuple[float, float]
    box: tuple[slice, slice]
    mask: BoolArray


def spots(
    mask: BoolArray, raster: Raster, least_mm2: float, least_width_mm: float
) -> list[PixelPatch]:
    """Patches of at least this area and width, the largest first; a shared corner joins pixels."""
    labels, count = label(mask, np.ones((3, 3)))
    if count == 0:
        return []
    areas = np.bincount(labels.ravel(), minlength=count + 1)[1:] * raster.pixel_mm**2
    boxes = find_objects(labels)
    chosen = [k for k in np.argsort(-areas, kind="stable").tolist() if areas[k] >= least_mm2]
    patches = [_spot(labels[boxes[k]] == k + 1, boxes[k], float(areas[k]), raster) for k in chosen]
    return [one for one in patches if one.width_mm >= least_width_mm]


def _spot(mask: BoolArray, box: tuple[slice, slice], area: float, raster: Raster) -> PixelPatch:
    rows, columns = box
    deep = distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1]
    j, i = np.unravel_index(int(np.argmax(deep)), deep.shape)
    x, y, half = raster.x_mm, raster.y_mm, raster.pixel_mm / 2
    return PixelPatch(
        area_mm2=area,
        width_mm=(2 * float(deep[j, i]) - 1) * raster.pixel_mm,
        at_mm=(float(x[columns.start + i]), float(y[rows.start + j])),
        low_mm=(float(x[columns.start]) - half, float(y[rows.start]) - half),
        high_mm=(float(x[columns.stop - 1]) + half, float(y[rows.stop - 1]) + half),
        box=box,
        mask=mask,
    )


_SAME_MM: Final = 2e-3
"""Ends nearer than this are one place: a G-code file rounds to a micron."""


@dataclass(frozen=True, eq=False)
class LayerLines:
    """What one layer writes, seen from above.

    Attributes
    ----------
    number : int
        From 1, the lowest.
    low_mm, high_mm : float, mm
        Between which heights of the part the layer lies.
    start, end : (n, 2) float64, mm
        Of the moves that write, in their order, part frame.
    width_mm : (n,) float64, mm
        Of each written line.
    line : (n,) int64
        Of the G-code file, from 1.
    joined : (n,) bool
        Whether the move goes on where the one before it ended.
    closed : (n,) bool
        Whether the line that the move is of comes back to where it began: a wall.
    travel : (m, 2, 2) float64, mm
        Ways without ink, start and end.
    """

    number: int
    low_mm: float
    high_mm: float
    start: FloatArray
    end: FloatArray
    width_mm: FloatArray
    line: IntArray
    joined: BoolArray
    closed: BoolArray
    travel: FloatArray

    @property
    def middle_mm(self) -> float:
        """Height at which a scan is cut to be held against the layer, mm."""
        return (self.low_mm + self.high_mm) / 2

    def upto(self, count: int) -> LayerLines:
        """The same layer with its first so many moves, and no travels."""
        return replace(
            self,
            start=self.start[:count],
            end=self.end[:count],
            width_mm=self.width_mm[:count],
            line=self.line[:count],
            joined=self.joined[:count],
            closed=self.closed[:count],
            travel=self.travel[:0],
        )


def layers_of(
    job: GcodeJob, place_mm: FloatArray, stretch: Stretch | None = None
) -> tuple[LayerLines, ...]:
    """All layers of a layered job, the lowest first.

    Parameters
    ----------
    job : GcodeJob
        Layered, with known line widths.
    place_mm : (3,) float64, mm
        Part to printer.
    stretch : Stretch or None
        Designed to written size, taken back: what lines are laid over has the designed one.
    """
    stretch = stretch or Stretch()
    order = np.argsort(job.layer, kind="stable")
    count = len(job.layers)
    at = np.searchsorted(job.layer[order], np.arange(count + 1))
    return tuple(_layer(job, k, order[at[k] : at[k + 1]], place_mm, stretch) for k in range(count))


def _layer(
    job: GcodeJob, index: int, rows: IntArray, place_mm: FloatArray, stretch: Stretch
) -> LayerLines:
    start, end = (stretch.back(way[rows] - place_mm)[:, :2] for way in (job.start, job.end))
    writes = job.writes[rows]
    joined = np.concatenate([[False], writes[:-1] & (np.diff(rows) == 1)])[writes]
    level = np.isin(job.act[rows], (Act.TRAVEL, Act.LIFTED, Act.WIPE))
    written = np.array([[0.0, 0.0, float(job.layers.z_mm[index]) - float(place_mm[2])]])
    top, height = float(stretch.back(written)[0, 2]), float(job.layers.height_mm[index])
    return LayerLines(
        number=index + 1,
        low_mm=top - height / stretch.factor[2],
        high_mm=top,
        start=start[writes],
        end=end[writes],
        width_mm=job.width_mm[rows][writes],
        line=job.line[rows][writes],
        joined=joined,
        closed=_closed(start[writes], end[writes], joined),
        travel=np.stack([start[level], end[level]], axis=1),
    )


def _closed(start: FloatArray, end: FloatArray, joined: BoolArray) -> BoolArray:
    """Of each move, whether its run of joined moves ends where it began."""
    first = np.flatnonzero(~joined)
    last = np.append(first[1:], len(joined)) - 1
    apart = np.linalg.norm(end[last] - start[first], axis=1)
    # There and back again on one line encloses nothing.
    loop = (apart < _SAME_MM) & (last - first >= 2)
    return np.repeat(loop, last - first + 1)


PIXELS_PER_LINE: Final = 6
MOST_PIXELS: Final = 1_000_000
_MARGIN_LINES: Final = 4.0


@dataclass(frozen=True)
class Raster:
    """Square pixels over a part, seen from above.

    Attributes
    ----------
    origin_mm : (float, float), mm
        Centre of pixel (0, 0), x and y, part frame.
    pixel_mm : float, mm
    shape : (ny, nx)
    """

    origin_mm: tuple[float, float]
    pixel_mm: float
    shape: tuple[int, int]

    @staticmethod
    def over(layers: Sequence[LayerLines], line_mm: float) -> Raster:
        """Pixels of a sixth of a line over all layers and a margin; at most a million."""
        ends = np.concatenate([part for one in layers for part in (one.start, one.end)])
        low = ends.min(axis=0) - _MARGIN_LINES * line_mm
        high = ends.max(axis=0) + _MARGIN_LINES * line_mm
        area = float(np.prod(high - low))
        pixel = max(line_mm / PIXELS_PER_LINE, (area / MOST_PIXELS) ** 0.5)
        nx, ny = np.ceil((high - low) / pixel).astype(int).tolist()
        return Raster((float(low[0]) + pixel / 2, float(low[1]) + pixel / 2), pixel, (ny, nx))

    @property
    def x_mm(self) -> FloatArray:
        """Of the pixels' centres, (nx,)."""
        return np.asarray(self.origin_mm[0] + self.pixel_mm * np.arange(self.shape[1]), np.float64)

    @property
    def y_mm(self) -> FloatArray:
        """Of the pixels' centres, (ny,)."""
        return np.asarray(self.origin_mm[1] + self.pixel_mm * np.arange(self.shape[0]), np.float64)

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Outer edges: left, right, bottom, top."""
        half, (ny, nx) = self.pixel_mm / 2, self.shape
        x, y = self.origin_mm
        wide, high = self.pixel_mm * nx, self.pixel_mm * ny
        return x - half, x - half + wide, y - half, y - half + high

    def owners(self, layer: LayerLines) -> NDArray[np.int32]:
        """The move whose axis is nearest among those whose band covers each pixel; -1 for none.

        (ny, nx) int32, places in the layer's arrays.
        """
        owner = np.full(self.shape, -1, np.int32)
        nearest = np.full(self.shape, np.inf, np.float32)
        goes_on = np.append(layer.joined[1:], [False])
        for k in range(len(layer.start)):
            where, away = self._band(layer, k, bool(goes_on[k]))
            closer = away < nearest[where]
            nearest[where][closer] = away[closer]
            owner[where][closer] = k
        return owner

    def _band(
        self, layer: LayerLines, k: int, goes_on: bool
    ) -> tuple[tuple[slice, slice], FloatArray]:
        """Pixels about a move, and their distances from its axis; inf outside its band."""
        a, b = layer.start[k], layer.end[k]
        half = float(layer.width_mm[k]) / 2
        where = self._box(np.minimum(a, b) - half, np.maximum(a, b) + half)
        x = self.x_mm[where[1]][None, :] - a[0]
        y = self.y_mm[where[0]][:, None] - a[1]
        length = float(np.hypot(*(b - a)))
        u, v = (b - a) / max(length, 1e-12)
        along, across = x * u + y * v, np.abs(y * u - x * v)
        # A hair more than half, so that no pixel falls between two lines that touch.
        inside = (along >= 0) & (along <= length) & (across <= half + 1e-6)
        away = np.where(inside, across, np.inf)
        if goes_on:
            joint = np.hypot(x - (b - a)[0], y - (b - a)[1])
            away = np.where(joint <= half, np.minimum(away, joint), away)
        return where, away

    def _box(self, low: FloatArray, high: FloatArray) -> tuple[slice, slice]:
        """Rows and columns of the pixels between two corners."""
        first = np.floor((low - self.origin_mm) / self.pixel_mm).astype(int)
        last = np.ceil((high - self.origin_mm) / self.pixel_mm).astype(int) + 1
        (x0, y0), (x1, y1) = np.maximum(first, 0), np.maximum(last, 0)
        return slice(int(y0), int(y1)), slice(int(x0), int(x1))

    def inside(self, rings: Sequence[FloatArray]) -> BoolArray:
        """Pixels inside closed contours (k, 2), mm, by the even-odd rule, (ny, nx)."""
        inside = np.zeros(self.shape, np.bool_)
        for ring in rings:
            where = self._box(ring.min(axis=0), ring.max(axis=0))
            shape = Polygon(ring)
            prepare(shape)
            x, y = np.meshgrid(self.x_mm[where[1]], self.y_mm[where[0]])
            inside[where] ^= contains_xy(shape, x, y)
        return inside


class LumenSections:
    """Level sections of a design's lumens.

    Parameters
    ----------
    lumens : Solid
        Part frame, mm.

    Raises
    ------
    ToolpathError
        When they aren't a closed manifold.
    """

    def __init__(self, lumens: Solid) -> None:
        self._body = manifold_of(lumens, "the model of the lumens")

    def mask(self, raster: Raster, height_mm: float) -> NDArray[np.bool_]:
        """Pixels inside a lumen at a height of the part, (ny, nx)."""
        return raster.inside(rings(self._body.slice(height_mm)))
