"""Decide pass, fail or undecided by a named rule (JCGM 106:2012, ISO 14253-1:2017)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from kernels.arrays import FloatArray
from registration.measuring.judging.tolerance import DecisionRule, Rule

Decision = Literal["pass", "undecided", "fail"]
ORDER: tuple[Decision, ...] = ("pass", "undecided", "fail")

COVERAGE = 1.96
"""Of a 95 % interval, normal."""
RISK = 0.01
"""Probability, at most, that a vessel whose true errors are all within tolerance fails, guarded."""
TESTS = 4
"""What shares that risk: what all sections err by together, each section's own noise, the mean
diameter, and the axis' offset."""
SHARED = np.linspace(-5.0, 5.0, 201)
"""Standard deviations at which the error that sections share is tried; 0.05 apart is finer than
any section's own noise."""


def decide(
    rule: Rule,
    error: FloatArray,
    u: FloatArray,
    u_fail: FloatArray,
    below: FloatArray,
    above: FloatArray,
) -> NDArray[np.int64]:
    """Decide on errors (n,) against the band from -below to above; return indices into `ORDER`.

    What isn't known (NaN of `error` or `u`) is undecided by every rule. Guarded (ISO 14253-1, 5):
    pass where error ± u lies within the band, fail where error ± u_fail lies without it; u_fail >=
    u keeps the risk of a false fail of a whole vessel, see `fail_width`. Conformance (JCGM 106, 7):
    by the normal distribution's part within the band, u / 1.96 its standard deviation.
    """
    if rule.name is DecisionRule.CONFORMANCE:
        return codes(rule, _part_within(error, u / COVERAGE, below, above))
    if rule.name is DecisionRule.SHARED_RISK:
        u = u_fail = np.where(np.isnan(u), np.nan, 0.0)
    within = (error + u <= above) & (error - u >= -below)
    beyond = (error - u_fail > above) | (error + u_fail < -below)
    return np.where(beyond, 2, np.where(within, 0, 1))


def codes(rule: Rule, probability: FloatArray) -> NDArray[np.int64]:
    """Decide by probabilities (n,) of conformance; NaN is undecided."""
    return np.where(probability >= rule.level, 0, np.where(probability <= 1 - rule.level, 2, 1))


def _part_within(
    value: FloatArray, standard: FloatArray, below: FloatArray, above: FloatArray
) -> FloatArray:
    """Part of a normal distribution within -below to above."""
    width = np.maximum(standard, 1e-9)
    return np.asarray(ndtr((above - value) / width) - ndtr((-below - value) / width))


def conformance(
    error: FloatArray, common: FloatArray, random: FloatArray, below: FloatArray, above: FloatArray
) -> tuple[FloatArray, float]:
    """Return the probability that each section of a vessel conforms (n,), and that all do.

    Errors (n,) hold one unknown that all sections share (standard uncertainty `common`) and noise
    of each section's own (`random`). Given the shared one sections are independent: the product of
    their probabilities is integrated over it. Neighbours' noise is alike in truth, which makes the
    joint probability larger than that.
    """
    if not len(error):
        return error, 1.0
    mean, own = _without_noise(error, random)
    shift = common[:, None] * SHARED
    own = np.maximum(own[:, None], 0.05 * common[:, None])
    each = _part_within(mean[:, None] - shift, own, below[:, None], above[:, None])
    weight = np.exp(-(SHARED**2) / 2)
    weight /= weight.sum()
    return np.asarray(each @ weight), float(each.prod(axis=0) @ weight)


def _without_noise(error: FloatArray, random: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the likeliest errors of a vessel's sections and what their noise leaves unknown.

    The worst of many noisy sections is worst by noise. Sections spread about the vessel's mean by
    their own differences and by noise, whose variance is known: of each one's distance from the
    mean the rest's part of the spread counts (empirical Bayes). A section that stands out as none
    of so many does by noise, in 99 of 100 vessels, counts as it is.
    """
    apart = error - error.mean()
    real = max(float(np.mean(apart**2 - random**2)), 0.0)
    part = real / np.maximum(real + random**2, 1e-12)
    stands_out = np.abs(apart) > ndtri(1 - RISK / 2 / len(error)) * random
    part = np.where(stands_out, 1.0, part)
    left = part + (1 - part) / len(error)
    return error.mean() + part * apart, np.sqrt(left) * random


def fail_width(common: FloatArray, random: FloatArray, sections: int) -> FloatArray:
    """Half width with which a section of a vessel may be called a fail, guarded.

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
