"""Find bare stretches of strokes, their ends and their p-values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray
from printctl.inspection.ink.chain import log_odds_of_bare
from printctl.inspection.ink.learn import LayerFit
from printctl.inspection.ink.shares import ACROSS_WIDTHS
from printctl.inspection.path_samples import PathSamples, stretches_of
from printctl.inspection.values import Gap

_CORE_WIDTHS: Final = 0.13
"""Half width of a line's core, in widths, where tips are located: round ends reach farthest
there."""
_MIN_CORE_POWER_SHARE: Final = 0.1
"""Least share of a profile's power in the core; below it the whole strip is used."""
_U_TIP_PX: Final = 0.5
"""Standard uncertainty of a tip by the pixel grid."""


@dataclass(frozen=True)
class Tips:
    """Share of ink along lines' middles, for locating tips.

    Attributes
    ----------
    samples : PathSamples
        As designed.
    share : (n,) float64
    spread : (n,) float64
    px_mm : float, mm
    """

    samples: PathSamples
    share: FloatArray
    spread: FloatArray
    px_mm: float

    @staticmethod
    def of(look: LayerFit, samples: PathSamples) -> Tips:
        """Measure the share in strips' cores, or in whole strips where cores show too little."""
        own, strips = look.view_fit.own, look.view_fit.strips
        core = np.abs(ACROSS_WIDTHS) <= _CORE_WIDTHS
        power = (own**2).sum(axis=2)
        inner = power[:, core].sum(axis=1)
        share = (strips * own)[:, core].sum(axis=(1, 2)) / np.maximum(inner, 1e-9)
        in_core = inner > _MIN_CORE_POWER_SHARE * power.sum(axis=1)
        share = np.where(in_core, share, look.ink_states.shares.share)
        return Tips(samples, share, look.ink_states.noise.full, 1.0 / look.view.px_per_mm)

    def end(self, first: int, last: int, way: int) -> tuple[float, float]:
        """Return where ink begins beyond a stretch's first or last place, and its u, mm."""
        samples, run = self.samples, self.samples.run[first]
        k, far = (last, first) if way > 0 else (first, last)
        while self.share[k] >= 0.5 and k != far:
            k -= way
        half = 0.5 * float(samples.step[k])
        while True:
            ahead = k + way
            if not 0 <= ahead < len(samples) or samples.run[ahead] != run:
                return float(samples.along[k] + way * half), _U_TIP_PX * self.px_mm
            low, high = self.share[k], self.share[ahead]
            if high >= 0.5:
                part = (0.5 - low) / (high - low) if high > low else 0.5
                part = min(max(part, 0.0), 1.0)
                slope = max(abs(high - low) / (2 * half), 0.5 / (2 * half))
                u = math.hypot(float(self.spread[k]) / slope, _U_TIP_PX * self.px_mm)
                return float(samples.along[k] + way * part * 2 * half), min(u, 2 * half)
            k = ahead


def find_gaps(
    look: LayerFit, samples: PathSamples, bare: BoolArray
) -> tuple[tuple[Gap, ...], FloatArray]:
    """Return the gaps in the order of writing, and the p-value of each bare place's gap, (n,).

    Bare places whose stretch has no length between the tips of ink have 1, as have all others.

    Parameters
    ----------
    look : LayerFit
    samples : PathSamples
        As designed.
    bare : (n,) bool
        Places more likely bare than not.
    """
    tips = Tips.of(look, samples)
    share = look.ink_states.shown_share
    gaps, p_value = list[Gap](), np.ones(len(samples))
    for first, last in stretches_of(bare, samples.run):
        log = log_odds_of_bare(share, look.ink_states.misfit, look.ink_states.noise, first, last)
        low, u_low = tips.end(first, last, -1)
        high, u_high = tips.end(first, last, 1)
        if high <= low:
            continue
        p_value[first : last + 1] = math.exp(min(-log, 0.0))
        gaps.append(
            Gap(
                int(samples.stroke[first]), low, high, _point_at(samples, first, low),
                _point_at(samples, last, high), max(u_low, u_high), float(p_value[first]),
                _u_shift_along(look, first, last),
            )
        )  # fmt: skip
    return _without_overlaps(gaps), p_value


def _without_overlaps(gaps: list[Gap]) -> tuple[Gap, ...]:
    """Drop gaps that an earlier one covers."""
    out = list[Gap]()
    for gap in gaps:
        if not (out and out[-1].overlaps(gap)):
            out.append(gap)
    return tuple(out)


def _point_at(samples: PathSamples, row: int, along: float) -> tuple[float, float]:
    """Return a point on the expected line, mm."""
    own = np.flatnonzero(samples.run == samples.run[row])
    at = samples.along[own]
    x, y = (float(np.interp(along, at, samples.point[own, k])) for k in range(2))
    for k, way in ((0, -1.0), (-1, 1.0)):  # beyond the first or last place
        rest = along - at[k]
        if rest * way > 0:
            normal = samples.normal[own[k]]
            x, y = x + rest * normal[1], y - rest * normal[0]
    return float(x), float(y)


def _u_shift_along(look: LayerFit, first: int, last: int) -> float:
    """Return the shift's larger standard uncertainty along the line at a gap's ends, mm."""
    normal = look.shifted.samples.normal[[first, last]]
    ahead = np.column_stack([normal[:, 1], -normal[:, 0]])
    power = np.einsum("ij,jk,ik->i", ahead, look.shift.covariance_mm2, ahead)
    return float(np.sqrt(max(float(power.max()), 0.0)))
