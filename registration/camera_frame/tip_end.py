"""Find where a needle ends in a patch, along its axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, map_coordinates

from registration.camera_frame.tip_axis import NeedleAxis
from registration.camera_frame.tip_patch import TipPatch
from registration.errors import PictureError

FloatArray = NDArray[np.float64]

_COLUMNS: Final = 17
"""Across the needle."""
_INNER: Final = 0.84
"""Of its width that is looked at."""
_STEP: Final = 0.5
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
    strip = _Strip(patch, axis)
    first = strip.change(lowest, highest)
    # What the needle looks like beside its end says more than above.
    first = strip.change(lowest, highest, first)
    share = np.linspace(-_INNER, _INNER, _COLUMNS)
    ends = strip.edges(first)
    good = np.isfinite(ends)
    if good.sum() < _LEAST_GOOD:
        raise PictureError(
            f"the needle's end isn't clear: {int(good.sum())} of {_COLUMNS} columns show an edge "
            f"({_LEAST_GOOD} wanted); put a plain ground of another brightness behind the tip, or "
            "give pictures with the needle at other places"
        )
    middle = ends + patch.end_px * axis.wide_px / patch.wide_px * np.sqrt(1 - share**2)
    for _ in range(5):
        at = float(np.median(middle[good]))
        slope = 0.0
        terms = np.column_stack([np.ones(good.sum()), share[good]])
        at, slope = np.linalg.lstsq(terms, middle[good], rcond=None)[0]
        off = middle - at - slope * share
        usual = max(1.4826 * float(np.nanmedian(np.abs(off[good]))), 0.05)
        again = np.isfinite(ends) & (np.abs(off) < 3.5 * usual)
        if again.sum() < _LEAST_GOOD or (again == good).all():
            break
        good = again
    count = good.sum() / 2  # columns beside each other share blur and ground
    u_slope = usual / np.sqrt(count) / 0.5
    return NeedleEnd(
        float(at),
        float(np.hypot(usual / np.sqrt(count), 0.05)),
        float(2 * slope / axis.wide_px + axis.lean),
        float(2 * u_slope / axis.wide_px),
        float(np.sqrt((off[good] ** 2).mean()) / axis.wide_px),
    )


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
            else np.broadcast_to(np.nanmean(self.outer, axis=1)[:, None], self.inner.shape)
        )
        beyond = (
            self.outer - self._sample(patch.ground, patch, axis, outer)
            if patch.ground is not None
            else self.outer - np.nanmean(self.outer, axis=1)[:, None]
        )
        spread = beyond - np.nanmedian(beyond)
        self.noise = max(1.4826 * float(np.nanmedian(np.abs(spread))), 0.004)

    def _sample(
        self, piece: FloatArray, patch: TipPatch, axis: NeedleAxis, beside: FloatArray
    ) -> FloatArray:
        rows = np.broadcast_to((self.heights - patch.above[0])[:, None], (len(self.heights), len(beside)))
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

    def edges(self, first: float) -> FloatArray:
        """Heights (m,) of the end in each column; NaN where needle and ground are alike."""
        reach = max(1.3 * self.wide, 4.0)
        needle, _ = self.look(first + 0.6 * self.wide, first + 4 * self.wide)
        rows = np.abs(self.heights - first) < reach
        heights, part = self.heights[rows], self.inner[rows]
        if self.known:
            ground = self.ground[rows]
        else:
            below = (self.heights < first - 0.7 * self.wide) & (
                self.heights > first - 2.2 * self.wide
            )
            level = np.nanmedian(self.inner[below], axis=0) if below.any() else np.nan
            ground = np.broadcast_to(level, part.shape)
        contrast = needle - ground
        with np.errstate(divide="ignore", invalid="ignore"):
            unit = (part - ground) / contrast
        unit = gaussian_filter1d(np.clip(np.nan_to_num(unit, nan=0.5), -0.5, 1.5), 1.0, axis=0)
        # Area above: from the end upwards the unit step is 1.
        low, high = heights[0], heights[-1]
        area = (unit[1:-1].sum(axis=0) + (unit[0] + unit[-1]) / 2) * _STEP
        found = high - area
        clear = np.median(np.abs(contrast), axis=0) > _LEAST_CONTRAST * self.noise
        sound = (unit[:4].mean(axis=0) < 0.35) & (unit[-4:].mean(axis=0) > 0.65)
        return np.where(clear & sound & (found > low) & (found < high), found, np.nan)
