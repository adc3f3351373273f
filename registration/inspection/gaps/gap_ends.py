"""Locate the ink tips at a gap's ends from linear light along the line, corrected for blur.

A camera blurs light, so that an end lies about where the light along the line's middle is half way
from ink to bath. A bead that broke off has a round end: it grows thin before its tip, and blur
takes more from it than from one cut square. How far the half-way place lies within either end
follows from the absorption and blur that widths were told by
(`registration.devices.microscope.ink_absorption`); how much light the bead's flanks show beside its
middle tells one from the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.devices.microscope.ink_absorption import Shade
from registration.inspection.gaps.gap_run import FINE, GapRun
from registration.inspection.ink.in_light import LightMix
from registration.inspection.values import FloatImage, Gap
from registration.inspection.ways import Seen, Ways

_CORE: Final = 0.15
"""Half of the part of a width along which ends are looked for."""
_FLANK: Final = (0.28, 0.42)
"""From a line's middle to where its flanks are looked at, in widths."""
_SMOOTH_PX: Final = 0.7
_CELLS: Final = 12
"""Of a modelled end, in a bead's radius."""
_SURE_PX: Final = 0.2
"""What an end's place is off by in the picture itself."""
_SOUND: Final = 0.75
"""Widths beyond a gap from which on ink is as it should be."""
_UNLIKE: Final = 0.04
"""Of a width: what ends differ by from either model."""
_PLAIN: Final = (1.0, 2.0)
"""Blur in pixels and μ d of beads that no width was told of."""

Shapes = tuple[tuple[float, float], tuple[float, float]]
"""Of a square and a round end: how far within the tip light is half that of ink, mm, in the line's
middle and on its flanks.
"""


@dataclass(frozen=True)
class Bead:
    """How a picture shows a line's end.

    Attributes
    ----------
    width_mm, blur_mm : float, mm
    thickness : float
        μ d.
    """

    width_mm: float
    blur_mm: float
    thickness: float

    @staticmethod
    def of(shade: Shade | None, width_mm: float, px_mm: float) -> Bead:
        """Take it from the widths' model, or what is usual where there is none."""
        if shade is None:
            return Bead(width_mm, _PLAIN[0] * px_mm, _PLAIN[1])
        return Bead(width_mm, shade.blur_mm, min(shade.per_mm * width_mm, 100.0))

    def half_way(self, is_round: bool, smooth_mm: float) -> tuple[float, float]:
        """How far within the tip light is half that of ink: in the middle, and on the flanks; mm.

        The end of a cylinder that is cut square, or of one with a half ball.
        """
        r = 0.5 * self.width_mm
        step = r / _CELLS
        far = 2.0 * r + 4.0 * self.blur_mm
        x = _cells(math.ceil((far + r) / step), math.ceil(far / step)) * step
        side = math.ceil((r + 4.0 * self.blur_mm) / step)
        t = _cells(side, side) * step
        beyond = np.maximum(x + r, 0.0) if is_round else np.where(x > 0, np.inf, 0.0)
        way = np.sqrt(np.maximum(r**2 - t[:, None] ** 2 - beyond**2, 0.0)) / r
        taken = np.expm1(-self.thickness * way) / math.expm1(-self.thickness)
        light = gaussian_filter(taken, self.blur_mm / step)
        light = gaussian_filter1d(light, smooth_mm / step, axis=1)
        core, flank = light[np.abs(t) <= 2 * _CORE * r], light[_flank(t / self.width_mm)]
        return _half_place(x, core.mean(axis=0)), _half_place(x, flank.mean(axis=0))


def _cells(before: int, behind: int) -> FloatArray:
    """Middles of so many cells on both sides of 0."""
    return np.arange(-before, behind, dtype=np.float64) + 0.5


def _flank(u: FloatArray) -> BoolArray:
    return np.asarray((np.abs(u) >= _FLANK[0]) & (np.abs(u) <= _FLANK[1]))


def _half_place(x: FloatArray, light: FloatArray) -> float:
    """Way from where light falls below half of what it begins with, to 0."""
    first = int(np.argmax(light < 0.5 * light[len(light) // 8]))
    drop = light[first - 1] - light[first]
    part = (light[first - 1] - 0.5 * light[len(light) // 8]) / max(drop, 1e-12)
    return -float(x[first - 1] + part * (x[first] - x[first - 1]))


@dataclass(frozen=True)
class LightAlong:
    """What measures ends: the picture without light, and how its beads look.

    Attributes
    ----------
    flat : (h, w, c) float32
    mix : LightMix
    ways : Ways
    seen : Seen
    width_mm : float, mm
        Of the layer's lines, as seen.
    shade : Shade or None
        Of the widths; None where none was told.
    px_mm : float, mm
    """

    flat: FloatImage
    mix: LightMix
    ways: Ways
    seen: Seen
    width_mm: float
    shade: Shade | None
    px_mm: float

    @cached_property
    def bead(self) -> Bead:
        """How the picture shows a line's end."""
        return Bead.of(self.shade, self.width_mm, self.px_mm)

    def measured(self, gaps: Sequence[Gap], ink: BoolArray, free: BoolArray) -> list[Gap]:
        """Return gaps with ends at the ink's tips.

        Parameters
        ----------
        gaps : sequence of Gap
        ink : (n,) bool
            Where it is seen.
        free : (n,) bool
            Where both sides are: a neighbour that touches hides how round an end is.
        """
        if not gaps:
            return []
        smooth = _SMOOTH_PX * self.px_mm
        shapes = (self.bead.half_way(False, smooth), self.bead.half_way(True, smooth))
        return [self._measured(gap, ink, free, shapes) for gap in gaps]

    def _measured(self, gap: Gap, ink: BoolArray, free: BoolArray, shapes: Shapes) -> Gap:
        run = GapRun.of(gap, self.ways, self.px_mm)
        if run is None:
            return gap
        light = self._light(run.rows, run.s, run.width_mm)
        look = _Along(run.s, *light, run.has_ink(ink), self.bead.width_mm, self.px_mm)
        old = ((gap.from_mm, gap.u_tip_mm), (gap.to_mm, gap.u_tip_mm))
        ends = [
            look.end(gap, way, shapes, run.is_alone(free)) or kept
            for way, kept in zip((-1, 1), old, strict=True)
        ]
        return run.with_ends([at for at, _ in ends], max(u for _, u in ends))

    def _light(self, rows: IntArray, s: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
        """Light along a run in a line's middle and on its flanks, (k,): bath 0, ink about 1."""
        along = self.ways.along[rows]
        at, across = (
            np.column_stack([np.interp(s, along, values[rows, k]) for k in (0, 1)])
            for values in (self.seen.at, self.seen.across)
        )
        u = np.linspace(-_FLANK[1], _FLANK[1], 21)
        place = (at[:, None] + (width * u)[:, None] * across[:, None]).astype(np.float32)
        logs = np.zeros((len(s), len(u), self.flat.shape[2]))
        for c in self.mix.used:
            channel = np.ascontiguousarray(self.flat[:, :, c])
            logs[:, :, c] = cv2.remap(
                channel, place[:, :, 0], place[:, :, 1], cv2.INTER_LINEAR, None,
                cv2.BORDER_REPLICATE,
            )  # fmt: skip
        light = self.mix.values(logs)
        smooth = gaussian_filter1d(light, _SMOOTH_PX * FINE, axis=0, mode="nearest")
        return smooth[:, np.abs(u) <= _CORE].mean(axis=1), smooth[:, _flank(u)].mean(axis=1)


@dataclass(frozen=True)
class _Along:
    """Light along a line about a gap.

    Attributes
    ----------
    s : (k,) float64, mm
        Along the stroke.
    core, flank : (k,) float64
        In the line's middle, and on its flanks.
    has_ink : (k,) bool
    width_mm, px_mm : float, mm
    """

    s: FloatArray
    core: FloatArray
    flank: FloatArray
    has_ink: BoolArray
    width_mm: float
    px_mm: float

    def end(self, gap: Gap, way: int, shapes: Shapes, alone: bool) -> tuple[float, float] | None:
        """Place of the tip before (-1) or behind (1) a gap, and its uncertainty, mm.

        None where there is no end to be seen.
        """
        middle = 0.5 * (gap.from_mm + gap.to_mm)
        order = np.flatnonzero(way * (self.s - middle) > 0)[::way]
        out = way * (self.s[order] - middle)
        far = self.has_ink[order] & (out > 0.5 * gap.length_mm + _SOUND * self.width_mm)
        core, flank = self.core[order], self.flank[order]
        inner = _crossing(out, core, far)
        outer = _crossing(out, flank, far) if alone else None
        if inner is None:
            return None
        place, slope = inner
        by_noise = 1.4826 * float(np.median(np.abs(core[far] - np.median(core[far])))) / slope
        is_round = 0.5 if outer is None else self._round(outer[0] - place, shapes, by_noise)
        square, rounded = (within for within, _ in shapes)
        within = (1.0 - is_round) * square + is_round * rounded
        unsure = abs(rounded - square) * math.sqrt(is_round * (1.0 - is_round))
        u = math.hypot(by_noise, unsure, _SURE_PX * self.px_mm, 0.5 * _UNLIKE * self.width_mm)
        return middle + way * (place - within), u

    def _round(self, behind: float, shapes: Shapes, by_noise: float) -> float:
        """How likely an end is a round one, whose flanks end so far behind its middle."""
        u = math.hypot(1.5 * by_noise, _UNLIKE * self.width_mm)
        square, rounded = (-0.5 * ((behind - (flank - core)) / u) ** 2 for core, flank in shapes)
        return 1.0 / (1.0 + math.exp(min(max(square - rounded, -50.0), 50.0)))


def _crossing(out: FloatArray, light: FloatArray, far: BoolArray) -> tuple[float, float] | None:
    """First place outwards with half the light of ink farther out, and the slope there.

    None where too little ink is seen, or no end of it.
    """
    if far.sum() < 2 * FINE:
        return None
    level = 0.5 * float(np.median(light[far]))
    stays = light >= level
    for k in range(1, FINE + 1):
        stays[:-k] &= light[k:] >= level
    if stays[0] or not stays.any():
        return None
    k = int(stays.argmax())
    low, high = max(k - FINE, 0), min(k + FINE, len(light) - 1)
    slope = float(light[high] - light[low]) / float(out[high] - out[low])
    rise = float(light[k] - light[k - 1])
    if slope <= 0 or rise <= 0:
        return None
    part = min(max((level - float(light[k - 1])) / rise, 0.0), 1.0)
    return float(out[k - 1] + part * (out[k] - out[k - 1])), slope
