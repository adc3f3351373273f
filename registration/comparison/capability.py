"""Process capability (Cp, Cpk) of several prints against a tolerance, with 95 % intervals.

Cp = (upper − lower)/6s, Cpk = min(upper − mean, mean − lower)/3s (ISO 22514-2). Both rest on a
normal process in control, which a handful of prints can't show; their intervals say how little a
handful tells. Cp: chi-squared; Cpk: Bissell 1990 (Applied Statistics 39, 331-340).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from registration.comparison.intervals import LEVEL, UNKNOWN, Interval, sd_factors


@dataclass(frozen=True)
class Capability:
    """Of one quantity against ± a tolerance about zero."""

    cp: Interval
    cpk: Interval


def capability(mean: float, sd: Interval, limit: float) -> Capability:
    """Capability of a quantity that should be zero and may be ± `limit`.

    Parameters
    ----------
    mean : float
    sd : Interval
        Over prints, as observed, in the unit of `mean`.
    limit : float
        Half the width of the tolerance, in the same unit.
    """
    if sd.df < 1 or sd.value == 0:
        return Capability(UNKNOWN, UNKNOWN)
    cp = limit / (3 * sd.value)
    low, high = sd_factors(sd.df)
    cpk = (limit - abs(mean)) / (3 * sd.value)
    normal = float(stats.norm.ppf(0.5 + LEVEL / 2))
    half = normal * float(np.sqrt(1 / (9 * (sd.df + 1)) + cpk**2 / (2 * sd.df)))
    return Capability(
        Interval(cp, cp / high, cp / low, sd.df), Interval(cpk, cpk - half, cpk + half, sd.df)
    )
