"""Fill a layer's region with straight parallel infill lines, clipped by scan conversion.

A line is a strip one width high. Where the region ends inside a strip, along a boundary nearly
parallel to the lines, a whole line would leave or overfill up to half a width; there a line of
half the width is written in the half of the strip that lies inside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.toolpath.fresh.paths import Paths, Role
from kernels.arrays import FloatArray, IntArray

#: Half lines shorter than this many widths aren't worth a start and a stop.
SHORTEST_HALF = 2.0
#: Lines that fill a region wholly differ by no more than this part of their width to fit in it.
STRETCH = 0.05
#: Nor whole lines shorter than this.
SHORTEST_WHOLE = 0.5


@dataclass(frozen=True)
class Lines:
    """Straight infill lines of a layer.

    Attributes
    ----------
    start, end : (n, 2) float64, mm
    width_mm : (n,) float64, mm
    """

    start: FloatArray
    end: FloatArray
    width_mm: FloatArray


@dataclass(frozen=True)
class Intervals:
    """Disjoint intervals on scan rows, in order of row and position.

    Attributes
    ----------
    row : (n,) int64
    low, high : (n,) float64, mm
    """

    row: IntArray
    low: FloatArray
    high: FloatArray

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

    Lines that fill it wholly are up to `STRETCH` wider or narrower, so that a whole number of them
    fits between its lowest and its highest place across them.
    """
    if density >= 1:
        lines = fill(contours, *_fitted(contours, width_mm, angle_deg, origin))
    elif density > 0:
        lines = spaced(contours, width_mm, width_mm / density, angle_deg, origin)
    else:
        lines = fill([], width_mm, angle_deg, origin)
    count = len(lines.width_mm)
    return Paths(
        np.stack([lines.start, lines.end], axis=1).reshape(-1, 2),
        np.repeat(lines.width_mm, 2),
        2 * np.arange(count + 1),
        np.zeros(count, dtype=np.bool_),
        np.full(count, int(Role.INFILL)),
        np.zeros(count, dtype=np.int64),
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
    if abs(fitted / width_mm - 1) > STRETCH:
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
    spans = _longer(spans, SHORTEST_WHOLE * width_mm)
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
    only_upper = _longer(subtract(upper, lower), SHORTEST_HALF * width_mm)
    only_lower = _longer(subtract(lower, upper), SHORTEST_HALF * width_mm)
    whole = subtract(subtract(middle, only_upper), only_lower)
    parts = [
        (_longer(whole, SHORTEST_WHOLE * width_mm), 0.5, 1.0),
        (only_upper, 0.75, 0.5),
        (only_lower, 0.25, 0.5),
    ]
    start, end, width = [], [], []
    for spans, place, part in parts:
        height = (spans.row + place) * width_mm
        start.append(np.column_stack([spans.low, height]))
        end.append(np.column_stack([spans.high, height]))
        width.append(np.full(len(height), part * width_mm))
    back = turn  # points @ turn is the inverse rotation, because turn is orthogonal
    return Lines(
        np.concatenate(start) @ back + origin,
        np.concatenate(end) @ back + origin,
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
