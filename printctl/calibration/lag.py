"""Fit pressure lag and flow factor to the widths of a line printed slow, fast, slow.

The line is written slow, fast, slow, always with the same ink per length. For a linear ink the flow
out of the needle follows τ dQ/dt = Q_in − Q (shared physics: τ = RC of needle and whatever gives
way), so after a change of speed the width is wrong for a while:

- slow to fast, at x beyond the change: Q = f A (v₂ + (v₁ − v₂) exp(−x / (v₂ τ)));
- fast to slow: Q = f A v₁ + (Q_end − f A v₁) exp(−x / (v₁ τ)),

with A the commanded cross-section and f the flow factor, what comes out over what is pushed. Width
w = Q/(h v) of a flat bead, w = √(4Q/(πv)) of a round filament. A lag compensation by advance adds
K dQ/dt to the push; for a linear ink K = τ. Rise and fall are fitted apart: where they differ, the
ink holds pressure by its yield stress, and no single K is right.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from scipy.optimize import least_squares

from kernels.arrays import FloatArray
from printctl.calibration.estimate import Estimate, quantile, reading_variance
from printctl.errors import UsageError

Bead = Literal["flat", "round"]
SETTLED: Final = 0.5
"""Part of the first, slow stretch that is left out: the prime's own transient."""
_STARTS: Final = (0.05, 0.5, 3.0)
_UNRESOLVED: Final = 20.0


@dataclass(frozen=True)
class LagPattern:
    """Geometry and speeds of the printed line.

    Attributes
    ----------
    slow_mm_s, fast_mm_s : float, mm/s
    length_mm : float, mm
        Of each of the three stretches.
    width_mm : float, mm
        Commanded.
    layer_mm : float, mm
        Height of a flat bead; not used for a round one.
    bead : "flat" or "round"
    """

    slow_mm_s: float = 4.0
    fast_mm_s: float = 16.0
    length_mm: float = 40.0
    width_mm: float = 0.4
    layer_mm: float = 0.2
    bead: Bead = "flat"

    @property
    def area_mm2(self) -> float:
        """Commanded cross-section."""
        if self.bead == "flat":
            return self.width_mm * self.layer_mm
        return math.pi / 4 * self.width_mm**2

    def facts(self) -> dict[str, float]:
        """Numbers that stand above a test's sheet."""
        numbers = {key: value for key, value in vars(self).items() if key != "bead"}
        return numbers | {"round": float(self.bead == "round")}

    def with_facts(self, facts: Mapping[str, float]) -> LagPattern:
        """The pattern with the numbers that stand above a sheet in place of its own."""
        slow, fast, length, width, layer, round_bead = (
            facts.get(key, value) for key, value in self.facts().items()
        )
        return LagPattern(slow, fast, length, width, layer, "round" if round_bead else "flat")


@dataclass(frozen=True)
class Lag:
    """Lag and flow factor fitted to the widths.

    Attributes
    ----------
    flow_factor : Estimate
    rise_s, fall_s : Estimate
        τ when the flow goes up, and down.
    advance_s : Estimate
        K, plunger travel per plunger speed: τ of the rise.
    linear : bool
        Whether rise and fall agree within their intervals.
    scatter_mm : float
        Standard deviation of one width.
    """

    flow_factor: Estimate
    rise_s: Estimate
    fall_s: Estimate
    advance_s: Estimate
    linear: bool
    scatter_mm: float

    def estimates(self) -> dict[str, Estimate]:
        """Return τ up and down, and K, by their names."""
        return {
            "τ, flow going up": self.rise_s,
            "τ, flow going down": self.fall_s,
            "K (advance)": self.advance_s,
        }


def expected_width(
    x_mm: FloatArray, flow_factor: float, rise_s: float, fall_s: float, pattern: LagPattern
) -> FloatArray:
    """Width along the line, from its begin, (n,), mm; see the module."""
    v1, v2, length = pattern.slow_mm_s, pattern.fast_mm_s, pattern.length_mm
    area = flow_factor * pattern.area_mm2
    fast, last = np.clip(x_mm - length, 0, None), np.clip(x_mm - 2 * length, 0, None)
    rising = area * (v2 + (v1 - v2) * np.exp(-np.minimum(fast, length) / (v2 * rise_s)))
    end = area * (v2 + (v1 - v2) * math.exp(-length / (v2 * rise_s)))
    falling = area * v1 + (end - area * v1) * np.exp(-last / (v1 * fall_s))
    flow = np.where(fast == 0, area * v1, np.where(last == 0, rising, falling))
    speed = np.where((fast == 0) | (last > 0), v1, v2)
    if pattern.bead == "flat":
        return flow / (pattern.layer_mm * speed)
    return np.asarray(np.sqrt(4 * flow / (math.pi * speed)))


def fit_lag(
    x_mm: FloatArray, width_mm: FloatArray, pattern: LagPattern, last_digit_mm: float = 0.0
) -> Lag:
    """Fit flow factor and both lags; the τ in their logarithms, so that they stay positive.

    Parameters
    ----------
    x_mm, width_mm : (n,) float64
        Place from the line's begin, and width there.
    pattern : LagPattern
    last_digit_mm : float, mm
        Of the widths.

    Raises
    ------
    UsageError
        With too few widths in a stretch, or widths that show no lag that could be told.
    """
    kept = (x_mm >= SETTLED * pattern.length_mm) & (x_mm <= 3 * pattern.length_mm)
    x, width = x_mm[kept], width_mm[kept]
    _enough(x, pattern)

    def residuals(p: FloatArray) -> FloatArray:
        factor, rise, fall = np.exp(p).tolist()
        return expected_width(x, factor, rise, fall, pattern) - width

    tries = [
        least_squares(residuals, np.log([1.0, tau, tau]), x_scale=1.0, method="lm")
        for tau in _STARTS
    ]
    best = min(tries, key=lambda tried: float(tried.cost))
    dof = len(x) - 3
    variance = max(2 * float(best.cost) / dof, reading_variance(last_digit_mm))
    try:
        covariance = variance * np.linalg.inv(best.jac.T @ best.jac)
    except np.linalg.LinAlgError as exc:
        raise UsageError(_no_lag(x, pattern)) from exc
    half = quantile(dof) * np.sqrt(np.diag(covariance))
    if not np.isfinite(half).all() or half[1:].max() > math.log(_UNRESOLVED):
        raise UsageError(_no_lag(x, pattern))
    factor, rise, fall = (
        Estimate(math.exp(p), math.exp(p - h), math.exp(p + h), unit)
        for p, h, unit in zip(best.x, half, ("", "s", "s"), strict=True)
    )
    apart = abs(best.x[1] - best.x[2])
    spread = covariance[1, 1] + covariance[2, 2] - 2 * covariance[1, 2]
    return Lag(
        factor,
        rise,
        fall,
        rise,
        bool(apart <= quantile(dof) * math.sqrt(max(spread, 0.0))),
        math.sqrt(variance),
    )


def _enough(x: FloatArray, pattern: LagPattern) -> None:
    for index, name in enumerate(("first, slow", "second, fast", "third, slow")):
        low, high = index * pattern.length_mm, (index + 1) * pattern.length_mm
        count = int(((x >= low) & (x < high)).sum())
        if count < 3:
            raise UsageError(
                f"{count} widths in the {name} stretch ({low:g} to {high:g} mm); measure at least "
                "3 in each, close together after each change of speed"
            )


def _no_lag(x: FloatArray, pattern: LagPattern) -> str:
    step = float(np.diff(np.unique(x)).min()) if len(np.unique(x)) > 1 else pattern.length_mm
    return (
        "the widths show no lag that could be told from their scatter: it is shorter than about "
        f"{step / pattern.fast_mm_s:.2g} s, or the widths are too rough; measure closer after the "
        "changes of speed, or take a larger difference of speeds"
    )
