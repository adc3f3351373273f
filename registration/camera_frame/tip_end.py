"""Find where a needle ends in a patch, along its axis."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from registration.camera_frame.tip_axis import NeedleAxis
from registration.camera_frame.tip_patch import TipPatch
from registration.errors import PictureError

FloatArray = NDArray[np.float64]

_COLUMNS: Final = 17
"""Across the needle."""
_INNER: Final = 0.84
"""Of its width that is looked at."""
_STEP: Final = 0.5
_SAME: Final = 0.12
"""Of the width, up to which it is the needle of the profile."""
_ROUNDS: Final = 3
_FLOOR_PX: Final = 0.2
"""No end is known better: its rim is lit otherwise than the rod."""
_NEAR_PX: Final = 3.5
_LEAST_GOOD: Final = 7
"""Columns whose end must be found."""
_LEAST_CONTRAST: Final = 3.0
"""Between needle and ground, of the ground's noise."""


@dataclass(frozen=True, eq=False)
class NeedleEnd:
    """The end of a needle in a patch.

    Attributes
    ----------
    above : float, px
        Of the end's middle, up from the expected tip.
    u_px : float
    slope : float
        Of the end against straight across: the rise over the whole width, of the width.
    u_slope : float
    rough : float
        RMS of the end about the ellipse it should be, of the width.
    """

    above: float
    u_px: float
    slope: float
    u_slope: float
    rough: float


def needle_end(patch: TipPatch, axis: NeedleAxis, lowest: float, highest: float) -> NeedleEnd:
    """Find the end between two heights, px above the expected tip.

    First the row where the needle's look gives way to the ground's is found by the likelihood of
    both; then in each column the edge, by the area under its step; then the ellipse is laid
    through them that a flat end shows.

    Raises
    ------
    PictureError
        When needle and ground are alike, or no clear end is there.
    """
    if abs(axis.wide_px / patch.wide_px - 1) < _SAME:
        axis = replace(axis, wide_px=patch.wide_px)  # the profile knows it better
    strip = _Strip(patch, axis)
    first = strip.change(lowest, highest)
    # What the needle looks like beside its end says more than above.
    first = strip.change(lowest, highest, first)
    share = np.linspace(-_INNER, _INNER, _COLUMNS)
    bow = patch.end_px * axis.wide_px / patch.wide_px * np.sqrt(1 - share**2)
    at, slope, reach = first + float(bow.mean()), 0.0, max(0.8 * axis.wide_px, 4.0)
    for _ in range(_ROUNDS):
        ends = strip.edges(at + slope * share - bow, reach)
        at, slope, off, good = _flat_end(ends + bow, share)
        reach = max(0.25 * axis.wide_px, _NEAR_PX)
    usual = max(1.4826 * float(np.median(np.abs(off[good]))), 0.05)
    count = good.sum() / 2  # columns beside each other share blur and ground
    u_slope = usual / np.sqrt(count) / 0.5
    return NeedleEnd(
        float(at),
        float(np.hypot(usual / np.sqrt(count), _FLOOR_PX)),
        float(2 * slope / axis.wide_px + axis.lean),
        float(2 * u_slope / axis.wide_px),
        float(np.sqrt((off[good] ** 2).mean()) / axis.wide_px),
    )


def _flat_end(
    middle: FloatArray, share: FloatArray
) -> tuple[float, float, FloatArray, NDArray[np.bool_]]:
    """Height and slope of a straight line through the columns, deviations, and which are good."""
    good = np.isfinite(middle)
    while True:
        if good.sum() < _LEAST_GOOD:
            raise PictureError(
                f"the needle's end isn't clear: {int(good.sum())} of {_COLUMNS} columns show an "
                f"edge ({_LEAST_GOOD} wanted); put a plain ground of another brightness behind the "
                "tip, or give pictures with the needle at other places"
            )
        terms = np.column_stack([np.ones(good.sum()), share[good]])
        at, slope = np.linalg.lstsq(terms, middle[good], rcond=None)[0]
        off = middle - at - slope * share
        usual = max(1.4826 * float(np.median(np.abs(off[good]))), 0.05)
        kept = good & (np.abs(off) < 3.5 * usual)
        if (kept == good).all():
            return float(at), float(slope), off, good
        good = kept


class _Strip:
    """The needle's course in a patch, sampled along and across its axis."""

    def __init__(self, patch: TipPatch, axis: NeedleAxis) -> None:
        self.heights = np.arange(patch.above[1], patch.above[-2], _STEP)
        self.wide = axis.wide_px
        half = axis.wide_px / 2
        inner = np.linspace(-_INNER, _INNER, _COLUMNS) * half
        outer = np.concatenate([-np.linspace(1.5, 2.9, 9)[::-1], np.linspace(1.5, 2.9, 9)]) * half
        self.inner = self._sample(patch.grey, patch, axis, inner)
        self.outer = self._sample(patch.grey, patch, axis, outer)
        self.known = patch.ground is not None
        self.ground = (
            self._sample(patch.ground, patch, axis, inner)
            if patch.ground is not None
            else np.broadcast_to(_row_means(self.outer)[:, None], self.inner.shape)
        )
        beyond = (
            self.outer - self._sample(patch.ground, patch, axis, outer)
            if patch.ground is not None
            else self.outer - _row_means(self.outer)[:, None]
        )
        spread = beyond - np.nanmedian(beyond)
        self.noise = max(1.4826 * float(np.nanmedian(np.abs(spread))), 0.004)

    def _sample(
        self, piece: FloatArray, patch: TipPatch, axis: NeedleAxis, beside: FloatArray
    ) -> FloatArray:
        rows = np.broadcast_to(
            (self.heights - patch.above[0])[:, None], (len(self.heights), len(beside))
        )
        columns = axis.beside + axis.lean * self.heights[:, None] + beside - patch.beside[0]
        return np.asarray(map_coordinates(piece, [rows, columns], order=1, cval=np.nan))

    def look(self, low: float, high: float) -> tuple[FloatArray, FloatArray]:
        """Needle's brightness across, between two heights, and its deviation along."""
        rows = (self.heights > low) & (self.heights < high) & np.isfinite(self.inner).all(axis=1)
        part = self.inner[rows]
        if len(part) < 4:
            raise PictureError("too little of the needle is in the picture above its tip")
        middle = np.median(part, axis=0)
        return middle, np.maximum(1.4826 * np.median(np.abs(part - middle), axis=0), 0.004)

    def change(self, low: float, high: float, first: float | None = None) -> float:
        """Height from which on the strip looks like the needle, and below like the ground."""
        begin = high if first is None else first + 0.5 * self.wide
        end = self.heights[-1] if first is None else first + 5 * self.wide
        needle, spread = self.look(begin, end)
        usual = np.hypot(spread, self.noise / 2)
        as_needle = np.minimum(((self.inner - needle) / usual) ** 2, 9.0) + 2 * np.log(usual)
        as_ground = np.minimum(((self.inner - self.ground) / self.noise) ** 2, 9.0)
        more = np.nansum(as_ground + 2 * np.log(self.noise) - as_needle, axis=1)
        gain = np.cumsum(more[::-1])[::-1]
        within = (self.heights >= low) & (self.heights <= high)
        gain = np.where(within, gain, -np.inf)
        best = int(gain.argmax())
        if best in (int(np.flatnonzero(within)[0]), int(np.flatnonzero(within)[-1])):
            raise PictureError(
                "the needle's end isn't within reach of where it should be; is the needle longer "
                "or bent, or its place (--tip-at) wrong? Raise --reach-mm"
            )
        return float(self.heights[best])

    def edges(self, expected: FloatArray, reach: float) -> FloatArray:
        """Heights (m,) of the end in each column; NaN where needle and ground are alike.

        A profile that rises from 0 to 1 at e has the integral of what lies above e, whatever its
        blur. It is taken within a reach of where the edge is expected: levels are never quite flat.
        """
        first = float(expected.mean())
        needle, _ = self.look(first + 0.5 * self.wide, first + 3 * self.wide)
        steps = np.arange(-reach, reach + _STEP / 2, _STEP)
        heights = expected + steps[:, None]
        rows = (heights - self.heights[0]) / _STEP
        columns = np.broadcast_to(np.arange(len(expected)), rows.shape)
        part = map_coordinates(self.inner, [rows, columns], order=1, cval=np.nan)
        if self.known:
            ground = map_coordinates(self.ground, [rows, columns], order=1, cval=np.nan)
        else:
            below = (self.heights < first - 0.6 * self.wide) & (
                self.heights > first - 1.8 * self.wide
            )
            level = _row_means(self.inner[below].T)
            ground = np.broadcast_to(level, part.shape)
        contrast = needle - ground
        with np.errstate(divide="ignore", invalid="ignore"):
            unit = np.clip((part - ground) / contrast, -1.0, 2.0)
        area = (unit[1:-1].sum(axis=0) + (unit[0] + unit[-1]) / 2) * _STEP
        heights_of_end = heights[-1] - area
        clear = np.median(np.abs(contrast), axis=0) > _LEAST_CONTRAST * self.noise
        sound = (unit[:3].mean(axis=0) < 0.5) & (unit[-3:].mean(axis=0) > 0.5)
        near = (heights_of_end > heights[0]) & (heights_of_end < heights[-1])
        return np.where(clear & sound & near, heights_of_end, np.nan)


def _row_means(values: FloatArray) -> FloatArray:
    """Means (n,) of what is known in each row of (n, m); NaN where nothing is."""
    known = np.isfinite(values)
    count = known.sum(axis=1)
    total = np.where(known, values, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
