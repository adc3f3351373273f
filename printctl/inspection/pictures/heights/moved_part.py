"""Check if one end of a height map moved against the other.

A map whose middle rows were lost shows its rest aside, and so does a layer in which motors lost
steps. Where ink is merely missing, none lies beside its lines; so two ends of a map count as moved
where no common place suits both as well as a place of its own suits each, and ink would lie where
none should; or where older ink would be missing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray, FloatArray
from printctl.inspection.pictures.heights.lost_rows import END_SHARE, MAX_MOVE_MM, MIN_MOVE_MM
from printctl.inspection.pictures.picture import draw_lines
from printctl.inspection.values import ExpectedLines, FloatImage, Frame

_MAX_PIXELS: Final = 2e5
"""Size to which maps are shrunk for the search."""
_MIN_BESIDE_SHARE: Final = 0.2
"""Least extra share of ink beside lines at the best common place over each part's own, summed over
both parts."""
_MIN_MISFIT_GAIN: Final = 0.3
"""The same for ink beside and ink missing together."""
_SHADED_THICKNESSES: Final = -0.45
"""Height over the layer's middle, in thicknesses, below which clipped cells are ground, not
hidden."""
_OLDER_INK_THICKNESSES: Final = -1.0
"""Height over the layer's middle, in thicknesses, above which the layer or the one below shows."""
_MAX_OWN_MISFIT: Final = 1.2
"""Largest misfit at the parts' own places, summed; above it their places are unknown."""
_MAX_MISFIT_IN_PLACE: Final = 0.25
"""Largest ink beside and missing of an end in place: 0.3 in 24 sound first layers of an independent
painter."""
_MAX_MISFIT_GAIN_ELSEWHERE: Final = 0.035
"""Largest gain in misfit elsewhere: 0.03 in these, 0.04 to 1.9 where rows were lost."""
_MIN_CELLS: Final = 100
"""Least number of cells of ink or lines."""
_BELOW_USUAL_THICKNESSES: Final = 0.5
"""Depth below ink's usual height, in thicknesses, down to which a surface is the layer's ink."""


@dataclass(frozen=True)
class _Fit:
    """Misfit of a map's part to its lines over rows and columns of its move.

    Attributes
    ----------
    beside, missing : (m, n) float64
        Share of the ink that lies beside lines, and of the lines that show none.
    """

    beside: FloatArray
    missing: FloatArray

    @property
    def off(self) -> FloatArray:
        """Share of ink beside lines plus share of lines without ink."""
        return self.beside + self.missing

    def best(self) -> tuple[int, int]:
        """Return the index of the best move."""
        row, column = np.unravel_index(int(self.off.argmin()), self.off.shape)
        return int(row), int(column)


def find_moved_part(picture: FloatImage, frame: Frame, lines: ExpectedLines) -> FloatArray | None:
    """Return the move of one end of a map against the other, (2,) px; None for none.

    Parameters
    ----------
    picture : (rows, columns, 2) float32
        Of `surface_of`.
    frame : Frame
    lines : ExpectedLines
    """
    level, height = picture[:, :, 0], picture[:, :, 1]
    shown: BoolArray = (
        (level > level.min() + 0.1) & (level < level.max() - 0.1) & (np.abs(level) > 0.2)
    )
    if shown.sum() < _MIN_CELLS:
        return None
    thickness_mm = float(np.median(height[shown] / level[shown]))
    known = (level > level.min()) | (height < _SHADED_THICKNESSES * thickness_mm)
    top = float(lines.end[lines.fresh, 2].max())
    below = ~lines.fresh & (lines.end[:, 2] > top - 1.5 * thickness_mm)
    usual = _usual(level, frame, lines, lines.fresh)
    moved = None
    if usual is not None:
        moved = _move_of_end(
            level > usual - _BELOW_USUAL_THICKNESSES,
            known,
            frame,
            lines,
            lines.fresh,
            _MIN_BESIDE_SHARE,
        )
    if moved is None and below.any():
        # Older ink was there: what is missing of it lies elsewhere.
        any_ink = height > _OLDER_INK_THICKNESSES * thickness_mm
        moved = _move_of_end(any_ink, known, frame, lines, below, -1.0)
    return moved


def is_in_place(picture: FloatImage, frame: Frame, lines: ExpectedLines) -> bool:
    """Return whether ink shows both ends of a map in place, along rows and columns.

    Nothing else within reach may fit an end better: behind lost rows ink lies aside. A whole line
    that is missing at a rim looks the same.

    Parameters
    ----------
    picture : (rows, columns, 2) float32
        Of `surface_of`.
    frame : Frame
    lines : ExpectedLines
    """
    level = picture[:, :, 0]
    usual = _usual(level, frame, lines, lines.fresh)
    if usual is None:
        return False
    planes = _planes(
        level > usual - _BELOW_USUAL_THICKNESSES, level > level.min(), frame, lines, lines.fresh
    )
    if planes is None:
        return False
    (ink, known, drawn), _, reach, least = planes
    for axis in (0, 1):
        for part in _parts(drawn, axis):
            fit = _fit([ink, known, drawn], part, axis, reach)
            if fit is None or not _fits_here(fit.off, axis, reach, least):
                return False
    return True


def _fits_here(off: FloatArray, axis: int, reach: int, least_px: float) -> bool:
    """Return whether a part fits at its place along an axis, and nowhere else better."""
    by = off.min(axis=1 - axis)  # the best across, of each move along
    move = np.abs(np.arange(-reach, reach + 1))
    near = move < max(least_px, 1.0)
    here = float(by[near].min())
    return bool(
        here < _MAX_MISFIT_IN_PLACE and float(by[~near].min()) > here - _MAX_MISFIT_GAIN_ELSEWHERE
    )


def _usual(level: FloatImage, frame: Frame, lines: ExpectedLines, use: BoolArray) -> float | None:
    """Return the usual height of ink in lines' middles, thicknesses; None for too little ink."""
    ends, px_per_mm = _ends(frame, lines, use)
    core = draw_lines(level.shape, ends, 0.3 * lines.width_mm[use] * px_per_mm) > 0
    return float(np.percentile(level[core], 80)) if core.sum() >= _MIN_CELLS else None


def _ends(frame: Frame, lines: ExpectedLines, use: BoolArray) -> tuple[FloatArray, float]:
    """Return both ends of lines, (n, 2, 2), px, and pixels per mm."""
    ends = np.stack([frame.to_pixels(one[use]) for one in (lines.start, lines.end)], axis=1)
    flat = np.linalg.norm((lines.end - lines.start)[use, :2], axis=1)
    long = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return ends, float(long.sum() / max(float(flat.sum()), 1e-9))


def _move_of_end(
    ink: BoolArray,
    known: BoolArray,
    frame: Frame,
    lines: ExpectedLines,
    use: BoolArray,
    beside: float,
) -> FloatArray | None:
    """Return one end's move against the other by lines ``use`` (n,), (2,) px; None for none."""
    found = _planes(ink, known, frame, lines, use)
    if found is None:
        return None
    planes, shrink, reach, least = found
    for axis in (0, 1):
        fits = [_fit(planes, end, axis, reach) for end in _parts(planes[2], axis)]
        moved = (
            None if None in fits else _relative_move([one for one in fits if one], least, beside)
        )
        if moved is not None:
            return moved * shrink
    return None


def _planes(
    ink: BoolArray, known: BoolArray, frame: Frame, lines: ExpectedLines, use: BoolArray
) -> tuple[list[FloatImage], float, int, float] | None:
    """Return shrunk masks of ink, known cells and lines, the factor, reach and least move, px."""
    ends, px_per_mm = _ends(frame, lines, use)
    drawn = draw_lines(ink.shape, ends, lines.width_mm[use] * px_per_mm) > 0
    if drawn.sum() < _MIN_CELLS:
        return None
    shrink = max(1.0, float(np.sqrt(ink.size / _MAX_PIXELS)))
    planes = [_shrunk(one, shrink) for one in (ink & known, known, drawn)]
    reach = max(2, round(MAX_MOVE_MM * px_per_mm / shrink))
    return planes, shrink, reach, MIN_MOVE_MM * px_per_mm / shrink


def _shrunk(mask: BoolArray, by: float) -> FloatImage:
    size = (max(1, round(mask.shape[1] / by)), max(1, round(mask.shape[0] / by)))
    small = cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.float32)


def _parts(drawn: FloatImage, axis: int) -> list[slice]:
    """Return slices of both ends of the lines' extent."""
    where = np.flatnonzero(drawn.any(axis=1 - axis))
    first, last = int(where[0]), int(where[-1]) + 1
    size = round(END_SHARE * (last - first))
    return [slice(first, first + size), slice(last - size, last)]


def _fit(planes: list[FloatImage], part: slice, axis: int, reach: int) -> _Fit | None:
    """Return the fit of a part's lines; None where there is too little ink or line."""
    ink, known, drawn = planes
    own = np.zeros_like(drawn)
    index = (part, slice(None)) if axis == 0 else (slice(None), part)
    own[index] = drawn[index]
    # Ink may lie as far from its part as the part may be moved.
    wide = slice(max(part.start - reach, 0), part.stop + reach)
    index = (wide, slice(None)) if axis == 0 else (slice(None), wide)
    grown = np.zeros_like(drawn)
    grown[index] = drawn[index]
    window = np.zeros_like(drawn)
    index = (part, slice(None)) if axis == 0 else (slice(None), part)
    window[index] = 1.0
    seen = ink * window
    total = float(seen.sum())
    on_ink, on_known, at_all = (
        _moved_sums(image, mask, reach) for image, mask in ((ink, own), (known, own), (seen, grown))
    )
    if total < _MIN_CELLS or float(own.sum()) < _MIN_CELLS:
        return None
    missing = 1.0 - on_ink / np.maximum(on_known, 1.0)
    return _Fit(1.0 - at_all / total, np.where(on_known < 0.5 * own.sum(), 1.0, missing))


def _moved_sums(image: FloatImage, mask: FloatImage, reach: int) -> FloatArray:
    """Return the sum of the image under a mask, moved by up to ``reach`` pixels each way."""
    wide = cv2.copyMakeBorder(image, *(reach,) * 4, cv2.BORDER_CONSTANT, value=0.0)
    return np.asarray(cv2.matchTemplate(wide, mask, cv2.TM_CCORR), dtype=np.float64)


def _relative_move(fits: list[_Fit], least_px: float, least_beside: float) -> FloatArray | None:
    """Return the second part's move against the first, (x, y); None if one place suits both."""
    places = [one.best() for one in fits]
    (row, column), (other_row, other_column) = places
    moved = np.array([other_column - column, other_row - row], dtype=np.float64)
    if np.hypot(*moved) < least_px:
        return None
    both = _Fit(fits[0].beside + fits[1].beside, fits[0].missing + fits[1].missing)
    common = both.best()
    own, own_beside = (
        math.fsum(float(part[at]) for part, at in zip(values, places, strict=True))
        for values in ([one.off for one in fits], [one.beside for one in fits])
    )
    beside = float(both.beside[common]) - own_beside
    if (
        float(both.off[common]) - own < _MIN_MISFIT_GAIN
        or beside < least_beside
        or own > _MAX_OWN_MISFIT
    ):
        return None
    return moved
