"""Sample points along fresh lines, and their projection into a picture."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import cv2
import numpy as np
from scipy.spatial import cKDTree

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.inspection.values import ExpectedLines, FloatImage, Frame, Image
from registration.errors import PictureError

_MIN_FLAT_SHARE = 0.3
"""Least share of a piece's length that shows from above; steeper pieces aren't judged."""
_OVERLAP_WIDTHS = 0.85
"""Distance in mean widths below which two lines overlap."""
_RETURN_RATIO = 1.25
"""Path length over distance of two places above which a line has turned back."""
_ROUNDING_MM = 1e-6
"""Tolerance for rounding of path lengths."""
_MIN_RAY_SINE = 0.2
"""Least sine of the angle between a line and its ray; below it is seen end on."""
_MIN_DEPTH_RANGE_WIDTHS = 0.5
"""Range of depths, in widths, above which lines differ in depth."""
_MIN_WIDTH_RATIO = 1.15
"""Largest over smallest width above which lines differ in width."""
_MAX_REMAP_ROWS = 20_000
"""Rows of one `cv2.remap`, which takes at most 2^15 samples a side."""


@dataclass(frozen=True)
class PathSamples:
    """Sample points along unbroken runs of fresh pieces, equally spaced in each run.

    Attributes
    ----------
    point : (n, 3) float64, mm
    normal : (n, 2) float64
        To the left of the way, as seen from above; a unit vector.
    piece, stroke, run : (n,) int64
    along : (n,) float64, mm
        From the stroke's begin.
    step : (n,) float64, mm
        Between neighbours.
    width : (n,) float64, mm
        Expected.
    to_end : (n,) float64, mm
        From the nearer end of the run.
    """

    point: FloatArray
    normal: FloatArray
    piece: IntArray
    stroke: IntArray
    run: IntArray
    along: FloatArray
    step: FloatArray
    width: FloatArray
    to_end: FloatArray

    def __len__(self) -> int:
        return len(self.piece)

    @cached_property
    def varied(self) -> bool:
        """True if lines differ in depth or width, so that their levels and hues differ.

        The darkness of translucent ink grows with its thickness, and the bath above veils it.
        """
        deep = float(np.ptp(self.point[:, 2])) > _MIN_DEPTH_RANGE_WIDTHS * float(
            np.median(self.width)
        )
        return deep or float(self.width.max()) > _MIN_WIDTH_RATIO * float(self.width.min())

    def crossed_in(self, projected: ProjectedSamples) -> BoolArray:
        """Return places (n,) over which a view shows another line, or the same line's way back.

        The density of translucent ink adds there: crossings, overlaps, sharp corners.
        """
        out = np.zeros(len(self), dtype=np.bool_)
        at = projected.at / projected.px_per_mm
        shown = np.flatnonzero(np.isfinite(at).all(axis=1))
        reach = _OVERLAP_WIDTHS * float(self.width.max())
        one, other = shown[cKDTree(at[shown]).query_pairs(reach, output_type="ndarray").T]
        apart = np.linalg.norm(at[one] - at[other], axis=1)
        along = np.abs(self._from_above[one] - self._from_above[other])
        same = (self.run[one] == self.run[other]) & (along <= _RETURN_RATIO * apart + _ROUNDING_MM)
        over = (apart < _OVERLAP_WIDTHS * 0.5 * (self.width[one] + self.width[other])) & ~same
        out[one[over]] = out[other[over]] = True
        return out

    @cached_property
    def _from_above(self) -> FloatArray:
        """Path length along all lines as seen from above, (n,), mm."""
        steps = np.linalg.norm(np.diff(self.point[:, :2], axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def only(self, rows: IntArray) -> PathSamples:
        """Return the samples of some rows."""
        return PathSamples(
            **{name: value[rows] for name, value in vars(self).items() if name in _FIELDS}
        )

    def moved(self, by_mm: FloatArray) -> PathSamples:
        """Return the samples moved by (2,) mm."""
        return replace(self, point=self.point + np.append(by_mm, 0.0))


_FIELDS = tuple(field.name for field in fields(PathSamples))


def _rim_directions(samples: PathSamples, frame: Frame, left: FloatArray) -> FloatArray:
    """Return directions (n, 3) from round lines' middles to the rims seen on their left.

    They are at right angles to the line and to the ray through its middle.
    """
    h = 0.5 * samples.width[:, None]
    columns = [
        (frame.to_pixels(samples.point + h * axis) - frame.to_pixels(samples.point - h * axis))
        / (2 * h)
        for axis in np.eye(3)
    ]
    by_place = np.stack(columns, axis=2)  # (n, 2, 3), px/mm
    ray = np.cross(by_place[:, 0], by_place[:, 1])
    ray *= np.where(ray[:, 2:] < 0, -1.0, 1.0)
    rim = np.cross(ray, _line_directions(samples))
    size = np.linalg.norm(rim, axis=1, keepdims=True)
    oblique = size > _MIN_RAY_SINE * np.linalg.norm(ray, axis=1, keepdims=True)
    return np.asarray(np.where(oblique, rim / np.maximum(size, 1e-12), left))


def _line_directions(samples: PathSamples) -> FloatArray:
    """Return the lines' directions in space, (n, 3), unit vectors."""
    ahead = np.column_stack([samples.normal[:, 1], -samples.normal[:, 0], np.zeros(len(samples))])
    step = np.diff(samples.point, axis=0)
    flat = np.linalg.norm(step[:, :2], axis=1)
    same = (np.diff(samples.piece) == 0) & (flat > 1e-9)
    slope = np.where(same, step[:, 2] / np.maximum(flat, 1e-9), 0.0)
    ahead[:-1, 2] = slope
    last = np.append(~same, True)
    ahead[1:, 2] = np.where(last[1:], slope, ahead[1:, 2])
    return np.asarray(ahead / np.linalg.norm(ahead, axis=1, keepdims=True))


def sample_paths(lines: ExpectedLines, step_mm: float) -> PathSamples:
    """Return sample points about each ``step_mm`` along all fresh runs."""
    length = np.linalg.norm(lines.end - lines.start, axis=1)
    flat = np.linalg.norm((lines.end - lines.start)[:, :2], axis=1)
    before = from_stroke_begin(lines.stroke, length)
    row = np.flatnonzero(lines.fresh & (length > 0) & (flat > _MIN_FLAT_SHARE * length))
    if not len(row):
        raise PictureError("expected lines: no fresh line has a way that can be seen from above")
    joined = (
        (np.diff(lines.stroke[row]) == 0)
        & (np.diff(row) == 1)
        & (np.abs(lines.start[row[1:]] - lines.end[row[:-1]]).max(axis=1) < 1e-3)
    )
    run = np.concatenate([[0], np.cumsum(~joined)])
    end = np.cumsum(length[row])
    begin = end - length[row]
    first = np.flatnonzero(np.concatenate([[True], ~joined]))
    last = np.append(first[1:], len(row)) - 1
    total = end[last] - begin[first]
    count = np.maximum(1, np.rint(total / step_mm)).astype(np.int64)
    own = np.repeat(np.arange(len(first)), count)
    number = np.arange(len(own)) - np.repeat(np.cumsum(count) - count, count)
    step = (total / count)[own]
    inside = (number + 0.5) * step
    at = begin[first][own] + inside
    k = np.clip(np.searchsorted(end, at, side="right"), first[own], last[own])
    width = lines.width_mm[row[k]]
    low, high = begin[first][own], end[last][own]
    reach = 0.3 * width
    back, ahead = (
        _points_at(lines, row, begin, end, np.clip(at + side, low, high))
        for side in (-reach, reach)
    )
    way = (ahead - back)[:, :2]
    own_way = (lines.end - lines.start)[row[k], :2]
    tiny = np.linalg.norm(way, axis=1) < 0.2 * reach
    way[tiny] = own_way[tiny]
    way /= np.linalg.norm(way, axis=1)[:, None]
    return PathSamples(
        point=_points_at(lines, row, begin, end, at),
        normal=np.column_stack([-way[:, 1], way[:, 0]]),
        piece=row[k],
        stroke=lines.stroke[row[k]],
        run=run[k],
        along=before[row[k]] + at - begin[k],
        step=step,
        width=width,
        to_end=np.minimum(inside, total[own] - inside),
    )


def from_stroke_begin(stroke: IntArray, length: FloatArray) -> FloatArray:
    """Return the path length from a stroke's begin to each piece, (n,), mm."""
    end = np.cumsum(length)
    fresh_stroke = np.concatenate([[True], np.diff(stroke) != 0])
    first = np.maximum.accumulate(np.where(fresh_stroke, np.arange(len(stroke)), 0))
    return np.asarray(end - length - (end - length)[first])


def _points_at(
    lines: ExpectedLines, row: IntArray, begin: FloatArray, end: FloatArray, at: FloatArray
) -> FloatArray:
    k = np.clip(np.searchsorted(end, at, side="left"), 0, len(row) - 1)
    share = ((at - begin[k]) / (end[k] - begin[k]))[:, None]
    return np.asarray(lines.start[row[k]] * (1 - share) + lines.end[row[k]] * share)


@dataclass(frozen=True)
class ProjectedSamples:
    """Sample points projected into the working picture.

    Attributes
    ----------
    at : (n, 2) float64, px
    across, along : (n, 2) float64, px/mm
        Derivatives by a step to the left, and by one ahead.
    """

    at: FloatArray
    across: FloatArray
    along: FloatArray

    @staticmethod
    def of(samples: PathSamples, frame: Frame, round_lines: bool = False) -> ProjectedSamples:
        """Project sample points by a frame, taken as linear over a line's width.

        The rim of ``round_lines`` is where rays touch them: viewed obliquely they are wider than a
        flat line of their width.
        """
        left = np.column_stack([samples.normal, np.zeros(len(samples))])
        if round_lines:
            left = _rim_directions(samples, frame, left)
        ahead = np.column_stack(
            [samples.normal[:, 1], -samples.normal[:, 0], np.zeros(len(samples))]
        )
        h = 0.5 * samples.width[:, None]
        middle = frame.to_pixels(samples.point)
        across = (frame.to_pixels(samples.point + h * left) - middle) / h
        along = (frame.to_pixels(samples.point + h * ahead) - middle) / h
        return ProjectedSamples(middle, across, along)

    @property
    def px_per_mm(self) -> float:
        """Square root of the median number of pixels in a square millimetre."""
        area = np.abs(self.across[:, 0] * self.along[:, 1] - self.across[:, 1] * self.along[:, 0])
        return float(np.sqrt(np.nanmedian(area)))

    def profiles(self, image: Image, across_mm: FloatArray) -> FloatImage:
        """Sample an image (h, w) across at (n, u) or (u,) mm, (n, u); borders repeat."""
        u = np.broadcast_to(across_mm, (len(self.at), across_mm.shape[-1]))
        x = (self.at[:, :1] + u * self.across[:, :1]).astype(np.float32)
        y = (self.at[:, 1:] + u * self.across[:, 1:]).astype(np.float32)
        parts = [
            cv2.remap(image, x[k], y[k], cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
            for k in (
                slice(first, first + _MAX_REMAP_ROWS) for first in range(0, len(x), _MAX_REMAP_ROWS)
            )
        ]
        return np.concatenate(parts)

    def inside(self, shape: tuple[int, ...], across_mm: FloatArray) -> BoolArray:
        """Return which places (n,) lie in a picture with ``across_mm`` to either side."""
        ok = np.ones(len(self.at), dtype=np.bool_)
        for side in (-1.0, 1.0):
            place = self.at + side * across_mm[:, None] * self.across
            ok &= ((place >= 0) & (place <= (shape[1] - 1, shape[0] - 1))).all(axis=1)
        return ok


def stretches_of(low: BoolArray, run: IntArray) -> list[tuple[int, int]]:
    """Return first and last row of each unbroken stretch of ``low`` within one run."""
    cut = np.concatenate([[True], run[1:] != run[:-1]])
    before = np.concatenate([[False], low[:-1]]) & ~cut
    after = np.concatenate([low[1:], [False]]) & ~np.append(cut[1:], True)
    first, last = np.flatnonzero(low & ~before), np.flatnonzero(low & ~after)
    return list(zip(first.tolist(), last.tolist(), strict=True))
