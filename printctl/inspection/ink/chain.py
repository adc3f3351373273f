"""Hidden Markov chain of full, thin, bare and hidden places on strokes.

The measured share at a place depends on its state and, by first-order autoregressive noise, on the
share measured at the place before; noise is Student's t. Clogs and bubbles persist along the
way, so states last some length (Rabiner 1989, Proceedings of the IEEE 77, 257).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from kernels.arrays import FloatArray, IntArray
from kernels.compile import jit
from printctl.inspection.ink.noise import Noise

FULL, THIN, BARE, HIDDEN = range(4)
_STUDENT_DOF: Final = 4.0
"""Degrees of freedom of Student's t: texture and bubbles have heavier tails than a normal law."""
_MIN_THIN_SHARE, _MAX_THIN_SHARE = 0.25, 0.85
"""Limits of the share of ink in thin stretches, uniformly distributed."""
_ONSETS_PER_MM: Final = (0.0, 1 / 500, 1 / 300, 1 / 300)
"""Onsets of each state per mm of full line: some faults in a print of metres."""
_MEAN_LENGTHS_MM: Final = (math.inf, 5.0, 1.0, 0.5)
"""Mean length of each state."""
_HIDDEN_MISFIT_RANGE_LOG: Final = 6.0
"""Range of log misfits, uniformly distributed, on a hidden place."""
_USUAL_MISFIT_LOG_ODDS: Final = 2.0
"""Log odds against a usual misfit on a hidden place."""
_HIDDEN_SHARE_RANGE: Final = 5.0
"""Range of shares, uniformly distributed, that a hidden place may read."""


def _stationary() -> FloatArray:
    begins, lasts = np.array(_ONSETS_PER_MM[1:]), np.array(_MEAN_LENGTHS_MM[1:])
    odds = begins * lasts
    return np.asarray(np.append(1.0, odds) / (1.0 + odds.sum()))


PRIOR_BARE: Final = float(_stationary()[BARE])
"""Prior probability of a bare place."""


def posterior(
    share: FloatArray, misfit: FloatArray, noise: Noise, run: IntArray, step_mm: FloatArray
) -> FloatArray:
    """Return probabilities of the four states at each place, (n, 4).

    Parameters
    ----------
    share : (n,) float64
        Ink measured, 1 for a full line; NaN where nothing was measured.
    misfit : (n,) float64
        Logarithm of how badly a place is explained by any share of ink.
    noise : Noise
    run : (n,) int64
        Number of the unbroken way that each belongs to.
    step_mm : (n,) float64, mm
    """
    emit = _emissions(share, misfit, noise)
    out = np.empty((len(share), 4))
    cut = np.flatnonzero(np.diff(run)) + 1
    bounds = np.concatenate([[0], cut, [len(run)]])
    _forward_backward(emit, bounds, _transitions(float(np.median(step_mm))), _stationary(), out)
    return out


def expected_ink(probability: FloatArray, share: FloatArray) -> FloatArray:
    """Return the share of ink expected at each place, (n,): thin ink as measured, full ink as 1."""
    there = np.maximum(1.0 - probability[:, HIDDEN], 1e-9)
    thin = probability[:, THIN] * np.clip(share, 0.0, 1.0)
    return np.asarray((probability[:, FULL] + thin) / there)


def log_odds_of_bare(
    share: FloatArray, misfit: FloatArray, noise: Noise, first: int, last: int
) -> float:
    """Return the log likelihood ratio of a stretch being bare or not, without any prior.

    One over that ratio is never smaller than the chance of such a reading on a line with ink
    (Markov's inequality), so that it serves as a p-value.
    """
    emit = _emissions(share, misfit, noise)[first : last + 1]
    bare = emit[0, BARE, 4] + emit[1:, BARE, BARE].sum()
    others = (FULL, THIN, HIDDEN)
    alone = emit[:, others, 4].max(axis=1)
    tied = np.max([emit[:, k, k] for k in others], axis=0)
    return float(bare - alone[0] - np.maximum(tied, alone)[1:].sum())


def _transitions(step_mm: float) -> FloatArray:
    """Return transition probabilities between states over one step, (4, 4)."""
    moves = np.zeros((4, 4))
    begins = np.array(_ONSETS_PER_MM) * step_mm
    moves[FULL] = begins
    moves[FULL, FULL] = 1.0 - begins[1:].sum()
    for k in (THIN, BARE, HIDDEN):
        ends = min(step_mm / _MEAN_LENGTHS_MM[k], 0.5)
        moves[k] = 0.1 * ends / 2
        moves[k, FULL] = 0.9 * ends
        moves[k, k] = 1.0 - ends
    return moves


def _emissions(share: FloatArray, misfit: FloatArray, noise: Noise) -> FloatArray:
    """Return log densities (n, 4, 5) of readings by state and previous state (4: none)."""
    known = np.isfinite(share)
    out = _of_shares(np.where(known, share, 0.0), np.append(np.nan, share[:-1]), noise)
    full, bare = (
        _log_t(np.maximum(misfit - level, 0.0), spread)
        for level, spread in (noise.misfit_full.T, noise.misfit_bare.T)
    )
    worst = np.maximum(noise.misfit_full.sum(axis=1), noise.misfit_bare.sum(axis=1))
    usual = np.maximum(full, bare)
    strange = np.where(
        misfit > worst,
        np.maximum(usual, -math.log(_HIDDEN_MISFIT_RANGE_LOG)),
        usual - _USUAL_MISFIT_LOG_ODDS,
    )
    alone = _independent_weight(noise.correlation)
    out[:, (FULL, THIN)] += (alone * full)[:, None, None]
    out[:, BARE] += (alone * usual)[:, None]
    out[:, HIDDEN] += (alone * strange)[:, None]
    out[~known] = 0.0
    return out


def _of_shares(x: FloatArray, last: FloatArray, noise: Noise) -> FloatArray:
    """Return log densities of shares (n,) given the ``last`` ones (n,), NaN for none."""
    out = np.zeros((len(x), 4, 5))
    out[:, FULL] = _log_t(x - 1.0, noise.full)[:, None]
    out[:, FULL, FULL] = _log_correlated(x, last, 1.0, noise.full, noise.correlation)
    # A bare place reads 0, or the apparent share that the shade of ink beside it adds.
    shade, spread = noise.shaded.T
    nothing, shaded = (
        np.repeat(_log_t(x - level, wide)[:, None], 5, axis=1)
        for level, wide in ((0.0, noise.bare), (shade, spread))
    )
    nothing[:, BARE] = _log_correlated(x, last, 0.0, noise.bare, noise.correlation)
    shaded[:, BARE] = _log_correlated(x, last, shade, spread, noise.correlation)
    out[:, BARE] = np.logaddexp(nothing, shaded) - math.log(2.0)
    out[:, THIN] = _log_between(x, noise.full)[:, None]
    # A thin stretch may have any share, but keeps it along its length.
    steady = _log_t(x - np.nan_to_num(last), noise.full * np.sqrt(1.0 - noise.correlation**2))
    keeps = np.isfinite(last) & (x > _MIN_THIN_SHARE) & (x < _MAX_THIN_SHARE)
    out[keeps, THIN, THIN] = np.maximum(out[keeps, THIN, THIN], steady[keeps])
    out[:, HIDDEN] = -math.log(_HIDDEN_SHARE_RANGE)
    return out


def _independent_weight(correlation: FloatArray) -> FloatArray:
    """Return the share of a place's information that is independent of its neighbours."""
    return (1.0 - correlation) / (1.0 + correlation)


def _log_correlated(
    x: FloatArray,
    last: FloatArray,
    middle: FloatArray | float,
    spread: FloatArray,
    correlation: FloatArray,
) -> FloatArray:
    """Return the log density of a share after a place of the same state."""
    rest = x - middle - correlation * np.nan_to_num(last - middle)
    alone = _log_t(x - middle, spread)
    news = _independent_weight(correlation)
    tied = _log_t(rest, spread * np.sqrt(1.0 - correlation**2))
    return np.where(np.isfinite(last), news * alone + (1.0 - news) * tied, alone)


def _log_t(rest: FloatArray, spread: FloatArray) -> FloatArray:
    """Return the log density of Student's t."""
    nu = _STUDENT_DOF
    norm = math.lgamma((nu + 1) / 2) - math.lgamma(nu / 2) - 0.5 * math.log(nu * math.pi)
    return np.asarray(norm - np.log(spread) - 0.5 * (nu + 1) * np.log1p((rest / spread) ** 2 / nu))


def _log_between(x: FloatArray, spread: FloatArray) -> FloatArray:
    """Return the log density of a thin share, blurred by noise."""
    low = 1.0 / (1.0 + np.exp(-1.7 * np.clip((x - _MIN_THIN_SHARE) / spread, -300, 300)))
    high = 1.0 / (1.0 + np.exp(-1.7 * np.clip((x - _MAX_THIN_SHARE) / spread, -300, 300)))
    return np.asarray(np.log(np.maximum(low - high, 1e-12) / (_MAX_THIN_SHARE - _MIN_THIN_SHARE)))


@jit
def _forward_backward(
    emit: FloatArray, bounds: IntArray, moves: FloatArray, begin: FloatArray, out: FloatArray
) -> None:
    """Fill posteriors of each run in place; emissions [t, state, state before or 4 for none]."""
    for r in range(len(bounds) - 1):
        lo, hi = bounds[r], bounds[r + 1]
        ahead = np.empty((hi - lo, 4))
        for t in range(lo, hi):
            top = -1e300
            for k in range(4):
                for j in range(5):
                    top = max(top, emit[t, k, j])
            total = 0.0
            for k in range(4):
                if t == lo:
                    value = begin[k] * np.exp(emit[t, k, 4] - top)
                else:
                    value = 0.0
                    for j in range(4):
                        value += ahead[t - lo - 1, j] * moves[j, k] * np.exp(emit[t, k, j] - top)
                ahead[t - lo, k] = value
                total += value
            for k in range(4):
                ahead[t - lo, k] /= max(total, 1e-300)
        back = np.ones(4)
        for t in range(hi - 1, lo - 1, -1):
            total = 0.0
            for k in range(4):
                out[t, k] = ahead[t - lo, k] * back[k]
                total += out[t, k]
            for k in range(4):
                out[t, k] /= max(total, 1e-300)
            if t == lo:
                break
            top = -1e300
            for k in range(4):
                for j in range(5):
                    top = max(top, emit[t, k, j])
            new = np.zeros(4)
            size = 0.0
            for j in range(4):
                for k in range(4):
                    new[j] += moves[j, k] * np.exp(emit[t, k, j] - top) * back[k]
                size += new[j]
            for j in range(4):
                back[j] = new[j] / max(size, 1e-300)
