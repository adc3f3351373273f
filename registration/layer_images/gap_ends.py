"""Measure where a gap's ink ends: at its tips on the line's middle, in light.

A camera blurs light, so that an end lies about where the light along the line's middle is half way
from ink to bath. A bead that broke off has a round end: it grows thin before its tip, and blur
takes more from it than from one cut square. How far the half-way place lies within either end
follows from the bead's model (`optics`); how much light the bead's flanks show beside its middle
tells one from the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from registration.layer_images.in_light import LightMix
from registration.layer_images.optics import Optics
from registration.layer_images.values import BoolArray, FloatArray, FloatImage, Gap
from registration.layer_images.ways import Seen, Ways

_CORE: Final = 0.15
"""Half of the part of a width along which ends are looked for."""
_FLANK: Final = (0.28, 0.42)
"""From a line's middle to where its flanks are looked at, in widths."""
_BEYOND: Final = 2.5
"""Widths of ink beside a gap that are looked at."""
_FINE: Final = 3
"""Samples in a pixel."""
_SMOOTH_PX: Final = 0.7
_CELLS: Final = 12
"""Of a modelled end, in a bead's radius."""
_SURE_PX: Final = 0.2
"""What an end's place is off by in the picture itself."""
_UNLIKE: Final = 0.04
"""Of a width: what ends differ by from either model."""
_PLAIN: Final = (1.0, 2.0)
"""Blur in pixels and μ d of beads that no width was told of."""


@dataclass(frozen=True)
class Bead:
    """How a picture shows a line's end.

    Attributes
    ----------
    width_mm, blur_mm : float, mm
    thickness : float
        μ d.
    gamma : float
    """

    width_mm: float
    blur_mm: float
    thickness: float
    gamma: float

    @staticmethod
    def of(optics: Optics | None, width_mm: float, px_mm: float) -> Bead:
        """Take it from the widths' model, or what is usual where there is none."""
        if optics is None:
            return Bead(width_mm, _PLAIN[0] * px_mm, _PLAIN[1], 1.6)
        return Bead(
            optics.diameter_mm, optics.shade.blur_mm, min(optics.thickness, 100.0), optics.gamma
        )

    def half_way(self, is_round: bool, smooth_mm: float) -> tuple[float, float]:
        """How far within the tip light is half that of ink: in the middle, and on the flanks; mm.

        The end of a cylinder that is cut square, or of one with a half ball.
        """
        r = 0.5 * self.width_mm
        step = r / _CELLS
        far = 2.0 * r + 4.0 * self.blur_mm
        x = (np.arange(-math.ceil((far + r) / step), math.ceil(far / step)) + 0.5) * step
        side = math.ceil((r + 4.0 * self.blur_mm) / step)
        t = (np.arange(-side, side) + 0.5) * step
        beyond = np.maximum(x + r, 0.0) if is_round else np.where(x > 0, np.inf, 0.0)
        way = np.sqrt(np.maximum(r**2 - t[:, None] ** 2 - beyond**2, 0.0)) / r
        taken = np.expm1(-self.thickness * way) / math.expm1(-self.thickness)
        light = gaussian_filter(taken, self.blur_mm / step)
        light = gaussian_filter1d(light, smooth_mm / step, axis=1)
        return tuple(
            _half_place(x, light[where].mean(axis=0))
            for where in (np.abs(t) <= 2 * _CORE * r, _flank(t / (2 * r)))
        )  # type: ignore[return-value]


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
    bead : Bead
    px_mm : float, mm
    """

    flat: FloatImage
    mix: LightMix
    ways: Ways
    seen: Seen
    bead: Bead
    px_mm: float

    def measured(self, gaps: Sequence[Gap], ink: BoolArray) -> list[Gap]:
        """Return gaps with ends at the ink's tips; ``ink`` (n,) is where it is seen."""
        if not gaps:
            return []
        smooth = _SMOOTH_PX * self.px_mm
        ends = [self.bead.half_way(is_round, smooth) for is_round in (False, True)]
        return [self._measured(gap, ink, ends) for gap in gaps]

    def _measured(self, gap: Gap, ink: BoolArray, ends: list[tuple[float, float]]) -> Gap:
        middle = 0.5 * (gap.from_mm + gap.to_mm)
        rows = np.flatnonzero(self.ways.stroke == gap.stroke)
        inside = np.abs(self.ways.along[rows] - middle).argmin()
        rows = rows[self.ways.run[rows] == self.ways.run[rows[inside]]]
        along, width = self.ways.along[rows], float(self.ways.width[rows].max())
        low = max(gap.from_mm - _BEYOND * width, float(along[0]))
        high = min(gap.to_mm + _BEYOND * width, float(along[-1]))
        s = np.arange(low, high, self.px_mm / _FINE)
        if len(s) < 4 * _FINE:
            return gap
        core, flank = self._light(rows, s, width)
        has_ink = np.interp(s, along, ink[rows].astype(np.float64)) > 0.99
        found = {}
        for way, name, old in ((-1.0, "from_mm", gap.from_mm), (1.0, "to_mm", gap.to_mm)):
            end = self._end(way, s, core, flank, has_ink, middle, old, ends)
            if end is not None:
                found[name] = end
        if not found:
            return gap
        u = max([end[1] for end in found.values()] + ([gap.u_mm] if len(found) < 2 else []))
        begin, last = (
            found.get(name, (getattr(gap, name), 0.0))[0] for name in ("from_mm", "to_mm")
        )
        if last <= begin:
            return gap
        place = self.ways.point[rows]
        where = [
            (float(np.interp(at, along, place[:, 0])), float(np.interp(at, along, place[:, 1])))
            for at in (begin, last)
        ]
        return replace(
            gap, from_mm=begin, to_mm=last, start_mm=where[0], end_mm=where[1], u_mm=float(u)
        )

    def _light(self, rows: FloatArray, s: FloatArray, width: float) -> tuple[FloatArray, ...]:
        """Light along a run in a line's middle and on its flanks, (k,) each: bath 0, ink about 1."""
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
        light = self.mix.values(logs, self.bead.gamma)
        smooth = gaussian_filter1d(light, _SMOOTH_PX * _FINE, axis=0, mode="nearest")
        return tuple(smooth[:, where].mean(axis=1) for where in (np.abs(u) <= _CORE, _flank(u)))

    def _end(
        self,
        way: float,
        s: FloatArray,
        core: FloatArray,
        flank: FloatArray,
        has_ink: BoolArray,
        middle: float,
        old: float,
        ends: list[tuple[float, float]],
    ) -> tuple[float, float] | None:
        """Place of the ink's tip on one side, and its uncertainty, mm; None where it isn't seen."""
        out = way * (s - middle)
        order = np.argsort(out)
        order = order[out[order] > 0]
        out, core, flank = out[order], core[order], flank[order]
        far = has_ink[order] & (out > way * (old - middle) + 0.75 * self.bead.width_mm)
        if far.sum() < 2 * _FINE:
            return None
        places, slopes = [], []
        for light in (core, flank):
            found = _crossing(out, light, 0.5 * float(np.median(light[far])))
            if found is None:
                return None
            places.append(found[0])
            slopes.append(found[1])
        scatter = 1.4826 * float(np.median(np.abs(core[far] - np.median(core[far]))))
        by_noise = scatter / max(slopes[0], 1e-9)
        is_round = self._chance_of_round(places[1] - places[0], ends, by_noise)
        within = (1.0 - is_round) * ends[0][0] + is_round * ends[1][0]
        unsure = abs(ends[1][0] - ends[0][0]) * math.sqrt(is_round * (1.0 - is_round))
        u = math.hypot(by_noise, unsure, _SURE_PX * self.px_mm, 0.5 * _UNLIKE * self.bead.width_mm)
        return middle + way * (places[0] - within), u

    def _chance_of_round(
        self, behind: float, ends: list[tuple[float, float]], by_noise: float
    ) -> float:
        """How likely an end is a round one, whose flanks end so far behind its middle."""
        expected = [flank - core for core, flank in ends]
        u = math.hypot(1.5 * by_noise, _UNLIKE * self.bead.width_mm)
        score = [-0.5 * ((behind - each) / u) ** 2 for each in expected]
        return 1.0 / (1.0 + math.exp(min(max(score[0] - score[1], -50.0), 50.0)))


def _crossing(out: FloatArray, light: FloatArray, level: float) -> tuple[float, float] | None:
    """First place outwards where light comes to a level and stays for some samples; its slope."""
    above = light >= level
    stays = above.copy()
    for k in range(1, _FINE + 1):
        stays[:-k] &= above[k:]
    if stays[0] or not stays.any():
        return None
    k = int(stays.argmax())
    rise = float(light[k] - light[k - 1])
    step = float(out[k] - out[k - 1])
    part = (level - float(light[k - 1])) / rise if rise > 1e-12 else 0.5
    reach = min(k + _FINE, len(light) - 1), max(k - _FINE, 0)
    slope = float(light[reach[0]] - light[reach[1]]) / float(out[reach[0]] - out[reach[1]])
    return float(out[k - 1]) + min(max(part, 0.0), 1.0) * step, slope
