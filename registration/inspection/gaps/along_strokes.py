"""Judge what is unclear beside a sure gap by the way that was written before and behind it.

Ink that has stopped stays away for a while: a chain of two states, ink or none, runs along the
places in the order of writing (a hidden Markov model; Rabiner 1989, doi:10.1109/5.18626). Its
evidence at a place is the presence seen there, where that counts; what other lines of the layer
cover of the place shows ink whether the line itself is there or not. Places are taken for missing
where the chain says so with a chance of 99 % at least, and only in one piece with a sure gap, so
that a layer without one is never faulted by it. A piece that is long enough ends where ink becomes
likelier than none.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.values import Gap
from registration.inspection.ways import DETOUR, Ways, stretches_of

_SURE: Final = 0.99
"""Chance of missing ink from which on it is told."""
_STOPS: Final = 0.02
"""Per mm, that ink stops coming, in a layer where it did so."""
_COMES: Final = 0.1
"""Per mm, that it comes again."""
_STOPS_ANEW, _COMES_ANEW = 0.02, 0.2
"""The same where the next stroke begins."""
_INDEPENDENT: Final = 2.0
"""Widths along a line, over which noise is one."""
_INK_SPREAD, _BARE_SPREAD = 0.25, 0.15
"""Least standard deviations of presence with and without ink."""
_ODD: Final = 0.05
"""Of the places show something else, anything from 0 to `_ODD_WIDE` alike."""
_ODD_WIDE: Final = 3.0
_CERTAIN: Final = 30.0
"""Logarithm of the odds in a sure gap."""
_CORE: Final = np.linspace(-0.32, 0.32, 9)
"""Of a width across a place, by which its presence is told."""
_COVERED: Final = 0.3
"""Of a place, from which on ink that is seen there may be another line's."""


def reached(
    gaps: list[Gap], level: FloatArray, clear: BoolArray, spread: float | FloatArray, ways: Ways
) -> tuple[list[Gap], BoolArray]:
    """Return gaps with what is missing beside them, and the places of that, (n,).

    Parameters
    ----------
    gaps : list of Gap
        Sure ones. Missing ink on another stroke than theirs becomes a gap of its own; its p-value
        is the likelihood of ink over that of none, which ink reaches by noise with no greater
        chance (Ville's inequality).
    level : (n,) float64
        Presence over that of sound ink; NaN where it tells nothing.
    clear : (n,) bool
        Places at which ink was told: they stay as they are, but where other lines cover them.
    spread : float or (n,) float64
        Standard deviation of the level of sound ink.
    ways : Ways
    """
    lost = np.zeros(len(ways), dtype=np.bool_)
    sure = lost.copy()
    for gap in gaps:
        sure |= _rows(gap, ways)
    if not sure.any() or clear.all():
        return gaps, lost
    cover = covered_share(ways)
    odds = _log_odds(level, cover, spread) * np.minimum(ways.step / (_INDEPENDENT * ways.width), 1)
    odds[sure] = _CERTAIN
    ink = np.ones(len(ways))
    for rows in _blocks(sure, ways.run):
        ink[rows] = _chance_of_ink(odds[rows], ways.step[rows], ways.run[rows])
    free = ~sure & (~clear | (cover > _COVERED))
    missing = sure | (free & (ink < 1.0 - _SURE))
    piece = np.cumsum(np.diff(missing, prepend=False) != 0)
    lost = missing & np.isin(piece, piece[sure]) & ~sure
    lost = _grown(lost, free & (ink < 0.5), ways)
    return _joined(gaps, lost, odds, ways), lost


def _grown(lost: BoolArray, likely: BoolArray, ways: Ways) -> BoolArray:
    """Go on from pieces of that length by `_INDEPENDENT` widths at most, over likely places."""
    out = lost.copy()
    for rows in _pieces(lost, ways.run):
        reach = round(_INDEPENDENT * float(ways.width[rows[0]] / ways.step[rows[0]]))
        if len(rows) < reach:
            continue
        for row, by in ((int(rows[-1]), 1), (int(rows[0]), -1)):
            for at in range(row + by, row + by * (reach + 1), by):
                if not 0 <= at < len(ways) or ways.run[at] != ways.run[row] or not likely[at]:
                    break
                out[at] = True
    return out


def _pieces(lost: BoolArray, run: IntArray) -> list[IntArray]:
    """Rows of each unbroken piece of one run."""
    return [np.arange(first, last + 1) for first, last in stretches_of(lost, run)]


def _rows(gap: Gap, ways: Ways) -> BoolArray:
    own = ways.stroke == gap.stroke
    return np.asarray(own & (ways.along >= gap.from_mm) & (ways.along <= gap.to_mm))


def covered_share(ways: Ways) -> FloatArray:
    """Share of each place's middle over which another line lies, or its own way back, (n,)."""
    at, reach = ways.point[:, :2], (0.5 + float(_CORE[-1])) * float(ways.width.max())
    one, other = cKDTree(at).query_pairs(reach, output_type="ndarray").T
    one, other = np.concatenate([one, other]), np.concatenate([other, one])
    off = at[other] - at[one]
    along = np.abs(ways.along[one] - ways.along[other])
    same = (ways.run[one] == ways.run[other]) & (along < DETOUR * np.linalg.norm(off, axis=1))
    one, other, off = one[~same], other[~same], off[~same]
    normal = ways.normal[one]
    aside = (off * normal).sum(axis=1)
    ahead = off[:, 0] * normal[:, 1] - off[:, 1] * normal[:, 0]
    across = ways.width[one, None] * _CORE - aside[:, None]
    hit = across**2 + ahead[:, None] ** 2 < (0.5 * ways.width[other, None]) ** 2
    out = np.zeros((len(ways), len(_CORE)), dtype=np.bool_)
    np.logical_or.at(out, one, hit)
    return np.asarray(out.mean(axis=1))


def _log_odds(level: FloatArray, cover: FloatArray, spread: float | FloatArray) -> FloatArray:
    """Logarithm of the odds of no ink against ink by what is seen at each place, (n,).

    Where a part of the place is covered, anything from nothing to that part may be seen.
    """
    ink = np.maximum(spread, _INK_SPREAD)
    far = np.maximum(1.0 - level, 0.0) / ink
    with_ink = np.exp(-0.5 * far**2) / (ink * math.sqrt(2.0 * math.pi))
    far = np.maximum(np.maximum(-level, level - cover), 0.0) / _BARE_SPREAD
    without = np.exp(-0.5 * far**2) / (cover + _BARE_SPREAD * math.sqrt(2.0 * math.pi))
    odd = _ODD / _ODD_WIDE
    odds = np.log((1.0 - _ODD) * without + odd) - np.log((1.0 - _ODD) * with_ink + odd)
    return np.asarray(np.nan_to_num(odds) * (1.0 - cover))


def _blocks(sure: BoolArray, run: IntArray) -> list[slice]:
    """Runs with sure gaps and those directly before and behind, in unbroken pieces."""
    number = np.unique(run, return_inverse=True)[1]
    use = np.zeros(int(number.max()) + 3, dtype=np.bool_)
    for by in (0, 1, 2):
        use[number[sure] + by] = True
    rows = use[number + 1]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]]).astype(np.int8)))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _chance_of_ink(odds: FloatArray, step: FloatArray, run: IntArray) -> FloatArray:
    """Chance of ink at each place of a chain, (n,), by sums forward and backward."""
    anew = np.diff(run, prepend=run[0]) != 0
    stops = 1.0 - np.exp(-_STOPS * step) * np.where(anew, 1.0 - _STOPS_ANEW, 1.0)
    comes = 1.0 - np.exp(-_COMES * step) * np.where(anew, 1.0 - _COMES_ANEW, 1.0)
    shown = np.exp(odds)
    rare = _STOPS / (_STOPS + _COMES)
    ahead, back = np.empty(len(odds)), np.empty(len(odds))
    none = rare  # chance of no ink by all up to here
    for k, (s, c, e) in enumerate(zip(stops, comes, shown, strict=True)):
        none = none * (1.0 - c) + (1.0 - none) * s if k else none
        none = none * e / (none * e + 1.0 - none)
        ahead[k] = none
    ratio = 1.0  # of what follows, without ink here over with
    for k in range(len(odds) - 1, -1, -1):
        back[k] = ratio
        s, c, e = stops[k], comes[k], shown[k] * ratio
        ratio = (c + (1.0 - c) * e) / (1.0 - s + s * e)
    return np.asarray((1.0 - ahead) / (1.0 - ahead + ahead * back))


def _joined(gaps: list[Gap], lost: BoolArray, odds: FloatArray, ways: Ways) -> list[Gap]:
    """Gaps with the missing places beside them, in the order of writing."""
    out = list(gaps)
    for rows in _pieces(lost, ways.run):
        first, last = int(rows[0]), int(rows[-1])
        begin, end = _edge(first, -0.5, ways), _edge(last, 0.5, ways)
        new = Gap(
            int(ways.stroke[first]), begin[0], end[0], begin[1], end[1],
            float(ways.width[first]) / math.sqrt(12.0),
            math.exp(min(0.0, -float(odds[rows].sum()))),
        )  # fmt: skip
        touching = [one for one in out if _touches(one, new, float(ways.step[first]))]
        out = [one for one in out if one not in touching] + [_with(new, touching)]
    return sorted(out, key=lambda one: (one.stroke, one.from_mm))


def _edge(row: int, by: float, ways: Ways) -> tuple[float, tuple[float, float]]:
    """Where a place begins or ends: along its stroke, and as a place, mm."""
    far = by * float(ways.step[row])
    x, y = ways.point[row, :2] + far * np.array([ways.normal[row, 1], -ways.normal[row, 0]])
    return float(ways.along[row]) + far, (float(x), float(y))


def _touches(one: Gap, other: Gap, near_mm: float) -> bool:
    apart = max(one.from_mm, other.from_mm) - min(one.to_mm, other.to_mm)
    return one.stroke == other.stroke and apart <= near_mm


def _with(new: Gap, touching: list[Gap]) -> Gap:
    """One gap from the first begin to the last end; as sure as the surest it goes on from."""
    every = [new, *touching]
    first = min(every, key=lambda one: one.from_mm)
    last = max(every, key=lambda one: one.to_mm)
    return replace(
        first,
        to_mm=last.to_mm,
        end_mm=last.end_mm,
        u_tip_mm=max(first.u_tip_mm, last.u_tip_mm),
        p_value=min(one.p_value for one in touching or [new]),
    )
