"""Locate the ink tips at a gap's ends from a profiler's heights along the line.

The surface falls there from ink's height to that of the ground, and is half way down where the ink
is half as high as usual. How far the tip lies beyond follows from the bead's section: the sides of
a section z = 1 - u^p (u from the middle, in half widths) are half as high at u^p = 1/2, and a round
end is that section turned about its last middle. An end cut square is half as high at its tip. How
much earlier the flanks end than the middle tells one from the other, where neighbours leave them
free. A tip that hides the ground behind it from the profiler's camera lies at the lit side of the
shadow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.gaps.gap_run import FINE, GapRun
from registration.inspection.gaps.gaps import merged
from registration.inspection.values import FloatImage, Gap
from registration.inspection.ways import Seen, Ways

_CORE: Final = np.linspace(-0.15, 0.15, 5)
_FLANK: Final = np.array([-0.42, -0.35, -0.28, 0.28, 0.35, 0.42])
"""Across a line, in widths: where its middle and its flanks are looked at."""
_SOUND: Final = 0.75
"""Widths beyond a gap from which on ink is as it should be."""
_NEAREST, _FARTHEST = 0.5, 1.5
"""Widths within and beyond a gap's end as it was found, between which its tip lies."""
_SMOOTH_PX: Final = 0.7
_LEAST_DEPTH, _MOST_DEPTH = 0.6, 1.0
"""Thicknesses from ink down to what lies below a gap: a short one is all slope, and between older
lines one sees deeper."""
_SHADE: Final = 1.8
"""Thicknesses: as long is the shadow of a layer's height where the camera leans by 60 degrees."""
_IN_SHADE: Final = 0.15
"""Of a shadow's length: uncertainty of a tip at its side."""
_NARROWEST, _WIDEST = 0.7, 0.97
"""Width at half height over a bead's whole width: of a cap, and of a bead with upright sides."""
_SURE_PX: Final = 0.3
_UNLIKE: Final = 0.05
"""Of a width: what ends differ by from either model."""
_PARALLEL: Final = 0.94
"""Cosine of 20 degrees, between lines that run side by side."""
_CORNER: Final = 2.5
"""Way along a line over the distance of two of its places, from which on it has come back."""


@dataclass(frozen=True)
class Section:
    """A bead's section, by how wide it is at half its height.

    Attributes
    ----------
    half_share, u_half_share : float
        Width at half height over the whole width, and its standard uncertainty.
    """

    half_share: float
    u_half_share: float

    @staticmethod
    def of_widths(ratio: FloatArray) -> Section:
        """Take it from widths at half height over designed ones, (m,); NaN where not told."""
        known = ratio[np.isfinite(ratio)]
        if not len(known):
            apart = _WIDEST - _NARROWEST
            return Section(0.5 * (_NARROWEST + _WIDEST), apart / math.sqrt(12.0))
        return Section(float(np.clip(np.median(known), _NARROWEST, _WIDEST)), _UNLIKE)

    def within(self) -> tuple[float, float]:
        """How far within a round end's tip its middle and flanks are half as high, in widths."""
        power = math.log(0.5) / math.log(self.half_share)
        found = []
        for across in (_CORE, _FLANK):
            side = 2.0 * np.abs(across)
            out = (0.5 * (1.0 + side**power)) ** (1.0 / power)
            found.append(0.5 - 0.5 * float(np.sqrt(np.maximum(out**2 - side**2, 0.0)).mean()))
        return found[0], found[1]


@dataclass(frozen=True)
class HeightsAlong:
    """What measures ends: heights, and how beads are shaped.

    Attributes
    ----------
    height : (h, w) float32
        Thicknesses.
    hidden : (h, w) bool
    ways : Ways
    seen : Seen
    section : Section
    thickness_mm, px_mm : float, mm
    """

    height: FloatImage
    hidden: BoolArray
    ways: Ways
    seen: Seen
    section: Section
    thickness_mm: float
    px_mm: float

    def measured(self, gaps: Sequence[Gap], ink: BoolArray, free: BoolArray) -> list[Gap]:
        """Return gaps with ends at the ink's tips, as `gap_ends.LightAlong.measured` does."""
        grown = [self._grown(gap, ink, _others(gap, gaps)) for gap in gaps]
        return [self._measured(gap, ink, free) for gap in merged(grown, self.ways)]

    def _grown(self, gap: Gap, ink: BoolArray, between: tuple[float, float]) -> Gap:
        """Gap with what lies as low beside it, up to the next ink that is seen.

        What wasn't told there (near a turn, a rim, a crossing line) may still be seen to be low.
        """
        run = GapRun.of(gap, self.ways, self.px_mm)
        if run is None:
            return gap
        rows, along = run.rows, self.ways.along[run.rows]
        height = self._heights(rows, along, run.width_mm * _CORE)
        own = (along >= gap.from_mm) & (along <= gap.to_mm)
        sure = ink[rows] & np.isfinite(height)
        if not own.any() or not sure.any() or not np.isfinite(height[own]).any():
            return gap
        top, floor = float(np.median(height[sure])), _median(height[own])
        low = ~ink[rows] & (height < top - 0.5 * max(top - floor, _LEAST_DEPTH))
        low &= (along > between[0]) & (along < between[1])
        at = np.flatnonzero(own)
        first, last = int(at[0]), int(at[-1])
        while first > 0 and low[first - 1]:
            first -= 1
        while last < len(rows) - 1 and low[last + 1]:
            last += 1
        ends = min(gap.from_mm, float(along[first])), max(gap.to_mm, float(along[last]))
        return run.with_ends(ends, gap.u_tip_mm)

    @cached_property
    def _known(self) -> FloatImage:
        """1 where heights were seen, (h, w)."""
        return (~self.hidden).astype(np.float32)

    def _measured(self, gap: Gap, ink: BoolArray, free: BoolArray) -> Gap:
        run = GapRun.of(gap, self.ways, self.px_mm)
        if run is None:
            return gap
        rows, s, width = run.rows, run.s, run.width_mm
        core, flank = (self._heights(rows, s, width * across) for across in (_CORE, _FLANK))
        alone = run.is_alone(free)
        look = _Fall(s, core, flank if alone else None, run.has_ink(ink), width, self)
        old = ((gap.from_mm, gap.u_tip_mm), (gap.to_mm, gap.u_tip_mm))
        covered = [self._covered(rows, at, width) for at, _ in old]
        ends = [
            kept if under else look.end(gap, way) or kept
            for way, kept, under in zip((-1, 1), old, covered, strict=True)
        ]
        u = max(math.hypot(one[1], under) for one, under in zip(ends, covered, strict=True))
        return run.with_ends([at for at, _ in ends], u)

    def _covered(self, rows: IntArray, at_mm: float, width: float) -> float:
        """Doubt of an end beside a line that crosses there: it may lie anywhere below, mm."""
        row = rows[np.abs(self.ways.along[rows] - at_mm).argmin()]
        away = np.linalg.norm(self.ways.point[:, :2] - self.ways.point[row, :2], axis=1)
        alike = np.abs(self.ways.normal @ self.ways.normal[row])
        way = np.abs(self.ways.along - self.ways.along[row])
        itself = (self.ways.run == self.ways.run[row]) & (way <= _CORNER * away)
        crosses = (away < width) & (alike < _PARALLEL) & ~itself
        return width / math.sqrt(3.0) if crosses.any() else 0.0

    def _heights(self, rows: IntArray, s: FloatArray, across_mm: FloatArray) -> FloatArray:
        """Mean height across a line at places along it, (k,), thicknesses; NaN where hidden."""
        along = self.ways.along[rows]
        at, across, ahead = (
            np.column_stack([np.interp(s, along, values[rows, k]) for k in (0, 1)])
            for values in (self.seen.at, self.seen.across, self.seen.along)
        )
        fine = Seen(at, across, ahead)
        heights = fine.profiles(self.height, across_mm[None, :])
        shown = fine.profiles(self._known, across_mm[None, :], nearest=True)
        count = shown.sum(axis=1)
        mean = (heights * shown).sum(axis=1) / np.maximum(count, 1.0)
        return np.where(2 * count >= len(across_mm), mean, np.nan).astype(np.float64)


@dataclass(frozen=True)
class _Fall:
    """Heights along a line about a gap.

    Attributes
    ----------
    s : (k,) float64, mm
        Along the stroke.
    core : (k,) float64
        In the line's middle, thicknesses; NaN where hidden.
    flank : (k,) float64 or None
        On its flanks; None where neighbours touch them.
    has_ink : (k,) bool
    width_mm : float, mm
    whole : HeightsAlong
    """

    s: FloatArray
    core: FloatArray
    flank: FloatArray | None
    has_ink: BoolArray
    width_mm: float
    whole: HeightsAlong

    def end(self, gap: Gap, way: int) -> tuple[float, float] | None:
        """Place of the tip before (-1) or behind (1) a gap, and its uncertainty, mm.

        None where there is no end to be seen.
        """
        middle = 0.5 * (gap.from_mm + gap.to_mm)
        half_mm = 0.5 * gap.length_mm
        begin = max(half_mm - _NEAREST * self.width_mm, 0.0)
        order = np.flatnonzero(way * (self.s - middle) > begin)[::way]
        out = way * (self.s[order] - middle)
        far = self.has_ink[order] & (out > half_mm + _SOUND * self.width_mm)
        inside = np.abs(self.s - middle) < 0.5 * half_mm
        floor = _median(self.core[inside])
        inner = self._half_way(out, self.core[order], far, floor)
        if inner is None or inner[0] > half_mm + _FARTHEST * self.width_mm:
            return None
        place, u_place = inner
        if not math.isfinite(place):  # too long a stretch wasn't seen there
            return (gap.from_mm if way < 0 else gap.to_mm), math.hypot(gap.u_tip_mm, u_place)
        within, u_within = self._within(out, order, far, inside, inner)
        u = math.hypot(u_place, u_within, _UNLIKE * self.width_mm, _SURE_PX * self.whole.px_mm)
        return middle + way * (place - within), u

    def _within(
        self,
        out: FloatArray,
        order: IntArray,
        far: BoolArray,
        inside: BoolArray,
        inner: tuple[float, float],
    ) -> tuple[float, float]:
        """How far the tip lies beyond where its middle is half as high, and the doubt of it, mm."""
        section, width = self.whole.section, self.width_mm
        core, flank = (width * one for one in section.within())
        is_round = 0.5
        if self.flank is not None:
            outer = self._half_way(out, self.flank[order], far, _median(self.flank[inside]))
            if outer is not None and math.isfinite(outer[0]):
                behind, u_behind = outer[0] - inner[0], math.hypot(outer[1], inner[1])
                u_behind = math.hypot(u_behind, _UNLIKE * width, _SURE_PX * self.whole.px_mm)
                odds = 0.5 * (behind**2 - (behind - (flank - core)) ** 2) / u_behind**2
                is_round = 1.0 / (1.0 + math.exp(min(max(-odds, -50.0), 50.0)))
        unsure = core * math.sqrt(is_round * (1.0 - is_round))
        return is_round * core, math.hypot(unsure, 0.5 * width * is_round * section.u_half_share)

    def _half_way(
        self, out: FloatArray, height: FloatArray, far: BoolArray, floor: float
    ) -> tuple[float, float] | None:
        """First place outwards that stays half as high as ink farther out; its uncertainty, mm.

        Its place is NaN where what wasn't seen is longer than a shadow.
        """
        ink = height[far & np.isfinite(height)]
        shown = np.flatnonzero(np.isfinite(height))
        if len(ink) < 2 * FINE or not math.isfinite(floor):
            return None
        top = float(np.median(ink))
        depth = min(max(top - floor, _LEAST_DEPTH), _MOST_DEPTH)
        level, x, z = top - 0.5 * depth, out[shown], _smooth(height[shown])
        stays = z >= level
        for k in range(1, FINE + 1):
            stays[:-k] &= z[k:] >= level
        if stays[0] or not stays.any():
            return None
        k = int(stays.argmax())
        dark = float(x[k] - x[k - 1])
        if dark > 2.0 * self.whole.px_mm:  # what lies between wasn't seen
            if dark > _SHADE * self.whole.thickness_mm + 2.0 * self.whole.px_mm:
                return math.nan, dark / math.sqrt(12.0)
            return float(x[k]), _IN_SHADE * dark
        low, high = max(k - FINE, 0), min(k + FINE, len(z) - 1)
        slope = max(float(z[high] - z[low]) / float(x[high] - x[low]), 0.2 * depth / self.width_mm)
        noise = 1.4826 * float(np.median(np.abs(ink - top)))
        part = (level - z[k - 1]) / max(float(z[k] - z[k - 1]), 1e-9)
        return float(x[k - 1] + min(max(part, 0.0), 1.0) * dark), noise / slope


def _others(gap: Gap, gaps: Sequence[Gap]) -> tuple[float, float]:
    """Ends of the stroke's other gaps next to one, mm along it; infinite for none."""
    own = [one for one in gaps if one.stroke == gap.stroke]
    before = [one.to_mm for one in own if one.to_mm <= gap.from_mm]
    behind = [one.from_mm for one in own if one.from_mm >= gap.to_mm]
    return max(before, default=-math.inf), min(behind, default=math.inf)


def _median(values: FloatArray) -> float:
    """Median of what was seen; NaN for nothing."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else math.nan


def _smooth(values: FloatArray) -> FloatArray:
    return np.asarray(gaussian_filter1d(values, _SMOOTH_PX * FINE, mode="nearest"))
