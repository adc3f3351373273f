"""Stretches of strokes that are bare, where their ink ends, and how sure that is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray
from registration.inspection.ink.chain import log_odds_of_bare
from registration.inspection.ink.learn import Learned
from registration.inspection.ink.shares import ACROSS
from registration.inspection.values import Gap
from registration.inspection.ways import Ways, stretches_of

_CORE: Final = 0.13
"""Widths around the middle, where a gap's tips are looked for: round ends reach farthest there."""
_TOLD: Final = 0.1
"""Of a profile's power that lies there, below which the whole strip tells where ink ends."""
_EDGE_PX: Final = 0.5
"""Of a pixel: what a tip may be off by in the picture itself."""


@dataclass(frozen=True)
class Tips:
    """Share of ink along lines' middles, by which tips are placed.

    Attributes
    ----------
    ways : Ways
        As designed.
    share : (n,) float64
    spread : (n,) float64
    px_mm : float, mm
    """

    ways: Ways
    share: FloatArray
    spread: FloatArray
    px_mm: float

    @staticmethod
    def of(look: Learned, ways: Ways) -> Tips:
        """Measure the middles of strips, or the whole where it shows more."""
        own, strips = look.drawn.own, look.drawn.strips
        core = np.abs(ACROSS) <= _CORE
        power = (own**2).sum(axis=2)
        inner = power[:, core].sum(axis=1)
        share = (strips * own)[:, core].sum(axis=(1, 2)) / np.maximum(inner, 1e-9)
        told = inner > _TOLD * power.sum(axis=1)
        share = np.where(told, share, look.judged.shares.share)
        return Tips(ways, share, look.judged.noise.full, 1.0 / look.view.px_per_mm)

    def end(self, first: int, last: int, way: int) -> tuple[float, float]:
        """Where ink begins by a stretch's first or last place, and its uncertainty, mm."""
        ways, run = self.ways, self.ways.run[first]
        k, far = (last, first) if way > 0 else (first, last)
        while self.share[k] >= 0.5 and k != far:
            k -= way
        half = 0.5 * float(ways.step[k])
        while True:
            ahead = k + way
            if not 0 <= ahead < len(ways) or ways.run[ahead] != run:
                return float(ways.along[k] + way * half), _EDGE_PX * self.px_mm
            low, high = self.share[k], self.share[ahead]
            if high >= 0.5:
                part = (0.5 - low) / (high - low) if high > low else 0.5
                part = min(max(part, 0.0), 1.0)
                slope = max(abs(high - low) / (2 * half), 0.5 / (2 * half))
                u = math.hypot(float(self.spread[k]) / slope, _EDGE_PX * self.px_mm)
                return float(ways.along[k] + way * part * 2 * half), min(u, 2 * half)
            k = ahead


def gaps_of(look: Learned, ways: Ways, bare: BoolArray) -> tuple[Gap, ...]:
    """Return the stretches that are bare, in the order of writing.

    Parameters
    ----------
    look : Learned
    ways : Ways
        As designed.
    bare : (n,) bool
        Places more likely bare than not.
    """
    tips = Tips.of(look, ways)
    share = look.judged.shown_share
    gaps = list[Gap]()
    for first, last in stretches_of(bare, ways.run):
        log = log_odds_of_bare(share, look.judged.misfit, look.judged.noise, first, last)
        low, u_low = tips.end(first, last, -1)
        high, u_high = tips.end(first, last, 1)
        if high <= low:
            continue
        gaps.append(
            Gap(
                int(ways.stroke[first]), low, high, _place(ways, first, low),
                _place(ways, last, high), max(u_low, u_high), math.exp(min(-log, 0.0)),
                _along(look, first, last),
            )
        )  # fmt: skip
    return _apart(gaps)


def _apart(gaps: list[Gap]) -> tuple[Gap, ...]:
    """Leave out gaps that another one already covers."""
    out = list[Gap]()
    for gap in gaps:
        if not (out and out[-1].meets(gap)):
            out.append(gap)
    return tuple(out)


def _place(ways: Ways, row: int, along: float) -> tuple[float, float]:
    """Point on the expected line, mm."""
    own = np.flatnonzero(ways.run == ways.run[row])
    at = ways.along[own]
    x, y = (float(np.interp(along, at, ways.point[own, k])) for k in range(2))
    for k, way in ((0, -1.0), (-1, 1.0)):  # beyond the first or last place
        rest = along - at[k]
        if rest * way > 0:
            normal = ways.normal[own[k]]
            x, y = x + rest * normal[1], y - rest * normal[0]
    return float(x), float(y)


def _along(look: Learned, first: int, last: int) -> float:
    """Standard uncertainty of the layer's place along the line at a gap's ends, the larger, mm."""
    normal = look.placed.ways.normal[[first, last]]
    ahead = np.column_stack([normal[:, 1], -normal[:, 0]])
    power = np.einsum("ij,jk,ik->i", ahead, look.shift.covariance_mm2, ahead)
    return float(np.sqrt(max(float(power.max()), 0.0)))
