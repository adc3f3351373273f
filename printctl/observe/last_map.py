"""Compare each look's height map with the last look's: rows or columns that it lacks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kernels.arrays import BoolArray
from printctl.observe.held_look import HeldLook
from printctl.observe.scan_place import ScanSize
from printctl.observe.views import View
from registration.layer_images import ExpectedLines, HeightFrame
from registration.layer_images.heights.lost_rows import lost_rows
from registration.layer_images.pictures.working import drawn_lines
from registration.layer_images.values import FloatImage

_WIDER = 2.0
"""Widths of a line, beside which its ink and its shadow change a map."""


class _Map(NamedTuple):
    heights: FloatImage
    size: ScanSize


@dataclass
class LastMap:
    """The last look's map, and the one of the look in hand."""

    _look: int = -1
    _own: _Map | None = None
    _last: _Map | None = None

    def lacks(self, at: HeldLook, view: View) -> str:
        """Say what a look's map lacks against the last look's, in words; empty for nothing."""
        if view.hidden is None or view.size is None:
            return ""
        if at.look.number != self._look:
            self._look, self._last, self._own = at.look.number, self._own or self._last, None
        now = _Map(view.taken, view.size)
        words = "" if self._last is None else _words(now, self._last, at)
        if not words:  # else the last whole one stays what the next look's is compared with
            self._own = now
        return words


def _words(now: _Map, last: _Map, at: HeldLook) -> str:
    if not _of_one_place(now.size, last.size):
        return ""
    still = ~_changed(last, at.layer.lines, at.since)
    y, x = now.size.voxel_mm
    lost = lost_rows(now.heights, last.heights, still, (y, x))
    told = [
        f"{count} of {whole} {what} ({1e3 * count * mm:.0f} µm)"
        for count, whole, what, mm in zip(
            lost, last.heights.shape, ("rows", "columns"), (y, x), strict=True
        )
        if count
    ]
    return " and ".join(told)


def _of_one_place(now: ScanSize, last: ScanSize) -> bool:
    """Whether two maps begin at one place and have the same cells."""
    return (
        np.allclose(now.voxel_mm, last.voxel_mm, rtol=1e-6)
        and np.allclose(now.to_scan, last.to_scan)
        and bool(np.all(np.abs(now.low_mm - last.low_mm) < 0.5 * min(now.voxel_mm)))
    )


def _changed(last: _Map, lines: ExpectedLines, since: BoolArray) -> BoolArray:
    """Where lines written ``since`` (n,) lie in the last map, (rows, columns)."""
    y, x = last.size.voxel_mm
    to_cells = np.diag([1 / x, 1 / y, 1.0, 1.0])
    to_cells[:2, 3] = -last.size.low_mm / (x, y)
    frame = HeightFrame(to_cells @ last.size.to_scan)
    ends = np.stack([frame.to_pixels(one[since]) for one in (lines.start, lines.end)], axis=1)
    drawn = drawn_lines(last.heights.shape, ends, _WIDER * lines.width_mm[since] / min(x, y))
    return np.asarray(drawn > 0)
