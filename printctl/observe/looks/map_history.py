"""Compare each look's height map with earlier ones: rows that it lacks, ground that has sunk."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

import cv2
import numpy as np

from kernels.arrays import BoolArray
from printctl.inspection import ExpectedLines, HeightFrame
from printctl.inspection.pictures.heights.lost_rows import (
    MIN_MOVE_MM,
    count_lost_rows,
    lowered_area_mm2,
)
from printctl.inspection.pictures.heights.moved_part import is_in_place
from printctl.inspection.pictures.heights.sunk import lift_sunken_ink
from printctl.inspection.pictures.picture import draw_lines
from printctl.inspection.values import FloatImage
from printctl.observe.deciding.evidence import MapCheck
from printctl.observe.looks.height_maps import ScanSize
from printctl.observe.looks.look_context import LookContext
from printctl.observe.looks.views import View

_CHANGED_WIDTHS = 2.0
"""Width of the band, in line widths, in which ink and its shadow change a map."""
_MAX_GONE_MM2: Final = 0.1
_MAX_KEPT_LEVELS: Final = 2
"""Levels whose maps are kept: a look at mends alone has its ground two looks back."""
_LEVEL_TOLERANCE_LAYERS: Final = 0.25
"""Share of a layer by which the distance to the one below may differ from one layer."""


class _Map(NamedTuple):
    heights: FloatImage
    size: ScanSize
    top_mm: float


@dataclass
class MapHistory:
    """Height maps of the last looks and of the current one."""

    _look: int = -1
    _own: _Map | None = None
    _earlier: list[_Map] = field(default_factory=list)

    def check(self, context: LookContext, view: View) -> MapCheck:
        """Check a map for lost rows and columns, by its frame and the last look's map."""
        if view.hidden is None or view.size is None:
            return MapCheck()
        if context.look.number != self._look:
            self._look = context.look.number
            self._keep_last()
        middle, thick = context.slab_mm
        now = _Map(view.taken, view.size, middle + thick / 2)
        found = self._compare(now, context, view)
        if not found.lacks:  # else the last whole one stays what the next look's is compared with
            self._own = now
        return found

    def lift_sunken_ground(self, context: LookContext, view: View) -> FloatImage:
        """Return a map's picture with ink on sunken ground lifted; note the depth in `context`."""
        if view.hidden is None or view.size is None or self._own is None:
            return view.image
        now, thick = self._own, view.thickness_mm
        ground = [
            one
            for one in self._earlier
            if abs(now.top_mm - one.top_mm - thick) < _LEVEL_TOLERANCE_LAYERS * thick
            and _has_same_cells(now, one)
        ]
        if not ground or now.heights is not view.taken:
            return view.image
        rise = now.heights - _resampled(ground[-1], now)
        size = (view.image.shape[1], view.image.shape[0])
        rise = cv2.resize(rise, size, interpolation=cv2.INTER_LINEAR)
        assert isinstance(view.frame, HeightFrame)
        px = float(np.sqrt(abs(np.linalg.det(view.frame.matrix[:2, :2]))))
        width = float(np.median(context.layer.lines.width_mm[context.layer.lines.fresh]))
        image, sunk_mm = lift_sunken_ink(view.image, view.hidden, rise, thick, width * px)
        context.map = context.map.combine(MapCheck(sunk_mm=sunk_mm))
        return image

    def _keep_last(self) -> None:
        """Keep the last look's map beside those of other levels."""
        if self._own is None:
            return
        top = self._own.top_mm
        others = [one for one in self._earlier if abs(one.top_mm - top) > 1e-3]
        self._earlier, self._own = [*others, self._own][-_MAX_KEPT_LEVELS:], None

    def _compare(self, now: _Map, context: LookContext, view: View) -> MapCheck:
        last = self._earlier[-1] if self._earlier else None
        last = last if last is not None and _has_same_origin(now, last) else None
        if last is None and now.size.whole is None:
            in_place = now.size.placed or is_in_place(view.image, view.frame, context.layer.lines)
            return MapCheck(unsized=not in_place)
        if last is None:
            assert now.size.whole is not None
            words = _count_words(_missing_counts(now, now.size.whole), now.size.whole, now.size)
            return MapCheck(f"lacks {words} that observe.frame names" if words else "")
        still = ~_changed_cells(last, context.layer.lines, context.since)
        y, x = now.size.voxel_mm
        lost = count_lost_rows(now.heights, last.heights, still, (y, x))
        if words := _count_words(lost, last.heights.shape, now.size):
            return MapCheck(f"lacks {words} against the last look's")
        if now.size.placed:
            return MapCheck()
        gone = lowered_area_mm2(now.heights - _resampled(last, now), view.thickness_mm, (y, x))
        if gone > _MAX_GONE_MM2:
            return MapCheck(
                f"lacks {gone:.2f} mm² of what stood there at the last look: rows were lost and "
                "filled up, or it was moved"
            )
        return MapCheck()


def _missing_counts(now: _Map, whole: tuple[int, int]) -> tuple[int, int]:
    """Return how many rows and columns a map lacks; 0 for hardly any."""
    each = zip(whole, now.heights.shape, now.size.voxel_mm, strict=True)
    rows, columns = (n - own if n - own >= max(2, MIN_MOVE_MM / mm) else 0 for n, own, mm in each)
    return rows, columns


def _count_words(lost: tuple[int, int], whole: tuple[int, ...], size: ScanSize) -> str:
    """Say how many rows and columns are lost; empty for none."""
    each = zip(lost, whole, ("rows", "columns"), size.voxel_mm, strict=True)
    counts = [f"{n} of {all_} {what} ({1e3 * n * mm:.0f} µm)" for n, all_, what, mm in each if n]
    return " and ".join(counts)


def _has_same_cells(now: _Map, last: _Map) -> bool:
    same = np.allclose(now.size.voxel_mm, last.size.voxel_mm, rtol=1e-6)
    return bool(same and np.allclose(now.size.to_scan, last.size.to_scan))


def _has_same_origin(now: _Map, last: _Map) -> bool:
    """Return whether two maps have the same origin and cells."""
    off = np.abs(now.size.low_mm - last.size.low_mm)
    return _has_same_cells(now, last) and bool(np.all(off < 0.5 * min(now.size.voxel_mm)))


def _resampled(last: _Map, now: _Map) -> FloatImage:
    """Return a map's heights at another one's cells, NaN beyond it, (rows, columns)."""
    step = np.array(now.size.voxel_mm[::-1])
    by = (now.size.low_mm - last.size.low_mm) / step
    move = np.array([[1.0, 0.0, by[0]], [0.0, 1.0, by[1]]])
    how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = now.heights.shape[::-1]
    return np.asarray(
        cv2.warpAffine(
            last.heights, move, size, flags=how, borderMode=cv2.BORDER_CONSTANT,
            borderValue=(float("nan"),) * 4,
        ),
        dtype=np.float32,
    )  # fmt: skip


def _changed_cells(last: _Map, lines: ExpectedLines, since: BoolArray) -> BoolArray:
    """Return the last map's cells under lines written ``since`` (n,), (rows, columns)."""
    y, x = last.size.voxel_mm
    to_cells = np.diag([1 / x, 1 / y, 1.0, 1.0])
    to_cells[:2, 3] = -last.size.low_mm / (x, y)
    frame = HeightFrame(to_cells @ last.size.to_scan)
    ends = np.stack([frame.to_pixels(one[since]) for one in (lines.start, lines.end)], axis=1)
    drawn = draw_lines(
        last.heights.shape, ends, _CHANGED_WIDTHS * lines.width_mm[since] / min(x, y)
    )
    return np.asarray(drawn > 0)
