"""Decide pass, fail or undecided by guard bands about the tolerance (ISO 14253-1)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from kernels.arrays import FloatArray

Decision = Literal["pass", "undecided", "fail"]
ORDER: tuple[Decision, ...] = ("pass", "undecided", "fail")

RISK = 0.01
"""Probability, at most, that a vessel whose true errors are all within tolerance fails."""
TESTS = 4
"""What shares that risk: what all sections err by together, each section's own noise, the mean
diameter, and the axis' offset."""


def decide(
    error: FloatArray,
    u: FloatArray,
    u_fail: FloatArray,
    below: FloatArray,
    above: FloatArray,
) -> NDArray[np.int64]:
    """Decide on errors (n,) against the band from -below to above; return indices into `ORDER`.

    Pass where error ± u lies within the band, fail where error ± u_fail lies without it, else
    undecided; so is what isn't known (NaN). ISO 14253-1:2017, 5 (conformity proven, nonconformity
    proven); u_fail >= u keeps the risk of a false fail of a whole vessel, see `fail_width`.
    """
    within = (error + u <= above) & (error - u >= -below)
    beyond = (error - u_fail > above) | (error + u_fail < -below)
    return np.where(beyond, 2, np.where(within, 0, 1))


def fail_width(common: FloatArray, random: FloatArray, sections: int) -> FloatArray:
    """Half width with which a section of a vessel may be called a fail.

    A vessel of n sections has n chances of a false fail. What the sections err by together
    (standard uncertainty `common`) is one chance; their own noise (`random`) is n, of which none
    is beyond z(1 - r/n) but with probability r, however they are correlated (Bonferroni). Each
    has a share r of `RISK`. At 30 sections: 2.8 common + 3.8 random, where U is 2.0 of both.
    """
    share = RISK / TESTS
    return np.asarray(ndtri(1 - share) * common + ndtri(1 - share / max(sections, 1)) * random)


def single_width(u: float) -> float:
    """Half width for one value of a vessel (its mean, its offset) with half width `u` (95 %)."""
    return float(ndtri(1 - RISK / TESTS) / ndtri(0.975)) * u


def worst_decision(decisions: Iterable[Decision]) -> Decision:
    """Return fail if any fails, else undecided if any is, else pass."""
    return ORDER[max((ORDER.index(one) for one in decisions), default=0)]
