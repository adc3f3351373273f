"""Compare each look's height map with earlier ones: rows that it lacks, ground that has sunk."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

import cv2
import numpy as np

from kernels.arrays import BoolArray
from printctl.observe.deciding.evidence import MapCheck
from printctl.observe.height_maps import ScanSize
from printctl.observe.held_look import HeldLook
from printctl.observe.views import View
from registration.inspection import ExpectedLines, HeightFrame
from registration.inspection.pictures.heights.lost_rows import (
    MIN_MOVE_MM,
    count_lost_rows,
    lowered_area_mm2,
)
from registration.inspection.pictures.heights.moved_part import is_in_place
from registration.inspection.pictures.heights.sunk import lift_sunken_ink
from registration.inspection.pictures.picture import draw_lines
from registration.inspection.values import FloatImage

_WIDER = 2.0
"""Widths of a line, beside which its ink and its shadow change a map."""
_GONE_MM2: Final = 0.1
_LEVELS: Final = 2
"""Of which maps are kept: of a look at mends alone the ground lies two looks back."""
_NEXT: Final = 0.25
"""Of a layer, by which the one below may lie nearer or farther than one layer."""


class _Map(NamedTuple):
    heights: FloatImage
    size: ScanSize
    top_mm: float


@dataclass
class LastMap:
    """The last looks' maps, and the one of the look in hand."""

    _look: int = -1
    _own: _Map | None = None
    _earlier: list[_Map] = field(default_factory=list)

    def check(self, at: HeldLook, view: View) -> MapCheck:
        """Say what is known of a map's rows and columns, by its frame and the last look's map."""
        if view.hidden is None or view.size is None:
            return MapCheck()
        if at.look.number != self._look:
            self._look = at.look.number
            self._keep()
        middle, thick = at.slab_mm
        now = _Map(view.taken, view.size, middle + thick / 2)
        found = self._checked(now, at, view)
        if not found.lacks:  # else the last whole one stays what the next look's is compared with
            self._own = now
        return found

    def judged(self, at: HeldLook, view: View) -> FloatImage:
        """Return a map's picture with ink on sunken ground lifted, and note by how much."""
        if view.hidden is None or view.size is None or self._own is None:
            return view.image
        now, thick = self._own, view.thickness_mm
        ground = [
            one
            for one in self._earlier
            if abs(now.top_mm - one.top_mm - thick) < _NEXT * thick and _has_same_cells(now, one)
        ]
        if not ground or now.heights is not view.taken:
            return view.image
        rise = now.heights - _laid_over(ground[-1], now)
        size = (view.image.shape[1], view.image.shape[0])
        rise = cv2.resize(rise, size, interpolation=cv2.INTER_LINEAR)
        assert isinstance(view.frame, HeightFrame)
        px = float(np.sqrt(abs(np.linalg.det(view.frame.matrix[:2, :2]))))
        width = float(np.median(at.layer.lines.width_mm[at.layer.lines.fresh]))
        image, sunk_mm = lift_sunken_ink(view.image, view.hidden, rise, thick, width * px)
        at.map = at.map.worse(MapCheck(sunk_mm=sunk_mm))
        return image

    def _keep(self) -> None:
        """Keep the last look's map beside those of other levels."""
        if self._own is None:
            return
        top = self._own.top_mm
        others = [one for one in self._earlier if abs(one.top_mm - top) > 1e-3]
        self._earlier, self._own = [*others, self._own][-_LEVELS:], None

    def _checked(self, now: _Map, at: HeldLook, view: View) -> MapCheck:
        last = self._earlier[-1] if self._earlier else None
        last = last if last is not None and _of_one_place(now, last) else None
        if last is None and now.size.whole is None:
            in_place = now.size.placed or is_in_place(view.image, view.frame, at.layer.lines)
            return MapCheck(unsized=not in_place)
        if last is None:
            assert now.size.whole is not None
            words = _count_words(_fewer(now, now.size.whole), now.size.whole, now.size)
            return MapCheck(f"lacks {words} that observe.frame names" if words else "")
        still = ~_changed(last, at.layer.lines, at.since)
        y, x = now.size.voxel_mm
        lost = count_lost_rows(now.heights, last.heights, still, (y, x))
        if words := _count_words(lost, last.heights.shape, now.size):
            return MapCheck(f"lacks {words} against the last look's")
        if now.size.placed:
            return MapCheck()
        gone = lowered_area_mm2(now.heights - _laid_over(last, now), view.thickness_mm, (y, x))
        if gone > _GONE_MM2:
            return MapCheck(
                f"lacks {gone:.2f} mm² of what stood there at the last look: rows were lost and "
                "filled up, or it was moved"
            )
        return MapCheck()


def _fewer(now: _Map, whole: tuple[int, int]) -> tuple[int, int]:
    """Rows and columns that a map has less than a whole one; 0 for hardly any."""
    each = zip(whole, now.heights.shape, now.size.voxel_mm, strict=True)
    rows, columns = (n - own if n - own >= max(2, MIN_MOVE_MM / mm) else 0 for n, own, mm in each)
    return rows, columns


def _count_words(lost: tuple[int, int], whole: tuple[int, ...], size: ScanSize) -> str:
    """Say how many rows and columns are lost; empty for none."""
    each = zip(lost, whole, ("rows", "columns"), size.voxel_mm, strict=True)
    told = [f"{n} of {all_} {what} ({1e3 * n * mm:.0f} µm)" for n, all_, what, mm in each if n]
    return " and ".join(told)


def _has_same_cells(now: _Map, last: _Map) -> bool:
    same = np.allclose(now.size.voxel_mm, last.size.voxel_mm, rtol=1e-6)
    return bool(same and np.allclose(now.size.to_scan, last.size.to_scan))


def _of_one_place(now: _Map, last: _Map) -> bool:
    """Whether two maps begin at one place and have the same cells."""
    off = np.abs(now.size.low_mm - last.size.low_mm)
    return _has_same_cells(now, last) and bool(np.all(off < 0.5 * min(now.size.voxel_mm)))


def _laid_over(last: _Map, now: _Map) -> FloatImage:
    """Heights of a map where another one's cells lie, NaN beyond it, (rows, columns)."""
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


def _changed(last: _Map, lines: ExpectedLines, since: BoolArray) -> BoolArray:
    """Where lines written ``since`` (n,) lie in the last map, (rows, columns)."""
    y, x = last.size.voxel_mm
    to_cells = np.diag([1 / x, 1 / y, 1.0, 1.0])
    to_cells[:2, 3] = -last.size.low_mm / (x, y)
    frame = HeightFrame(to_cells @ last.size.to_scan)
    ends = np.stack([frame.to_pixels(one[since]) for one in (lines.start, lines.end)], axis=1)
    drawn = draw_lines(last.heights.shape, ends, _WIDER * lines.width_mm[since] / min(x, y))
    return np.asarray(drawn > 0)
