"""Estimate each line's own ink level and colour scatter, where lines differ in depth or width."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.values import FloatImage
from registration.inspection.ways import Seen, Ways

_MOST: Final = 75.0
"""Percentile of a line's presence: three quarters of it may be missing."""
_LEAST: Final = 0.1
_SURE: Final = 6.0
"""Of the usual presence, and standard deviations of bath, from which on it is ink."""
_ALIKE: Final = 1.0
"""Widths along a line, over which bath is one: so many places tell a line's level together."""
_FEWEST: Final = 4
_SAME_WIDTH: Final = 0.01
_STRAIGHT: Final = 0.9
"""Cosine of a turn, below which another line begins."""
_NEAR: Final = 0.25
"""Of a line's level: ink that its slope is learned from."""
_ROUNDS: Final = 4
_WIDER: Final = 1.3
_RIM: Final = 0.3
"""Of a line's width, by which the blur of a wider one's rim reaches into it."""


def lines_of(ways: Ways) -> IntArray:
    """Return the number of the line that each place is on, (n,): of one width, without a turn."""
    _, piece = np.unique(ways.piece, return_inverse=True)
    total = np.stack([np.bincount(piece, ways.normal[:, c]) for c in range(2)], axis=1)
    normal = total / np.maximum(np.linalg.norm(total, axis=1), 1e-9)[:, None]
    here, before = piece[1:], piece[:-1]
    turned = (normal[here] * normal[before]).sum(axis=1) < _STRAIGHT
    wider = np.abs(ways.width[1:] / ways.width[:-1] - 1.0) > _SAME_WIDTH
    return np.concatenate([[0], np.cumsum(turned | wider | (np.diff(ways.run) != 0))])


def line_levels(
    presence: FloatArray, ways: Ways, good: BoolArray, bath: FloatArray | None
) -> FloatArray:
    """Return the presence that each line's own ink has, (n,); 1 where it shows none.

    It may rise or fall along a line, which leads upwards or downwards.

    Parameters
    ----------
    presence : (n,) float64
        By the usual ink of the layer.
    ways : Ways
    good : (n,) bool
        Seen.
    bath : (k,) float64 or None
        Presence where there is bath alone.
    """
    noise = 0.0 if bath is None else float(bath.std())
    level, line = np.ones(len(ways)), lines_of(ways)
    alone = good & ~ways.crossed & ~_in_wider(ways, line)
    for number in range(int(line[-1]) + 1):
        rows = line == number
        own = rows & alone
        apart = float((ways.step[own] / (_ALIKE * ways.width[own])).sum())
        least = max(_LEAST, _SURE * noise / np.sqrt(max(1.0, apart)))
        usual = float(np.percentile(presence[own], _MOST)) if own.sum() >= _FEWEST else 0.0
        if usual > least:
            level[rows] = np.maximum(_sloped(presence, ways.along, rows, own, usual), least)
    return level


def _in_wider(ways: Ways, line: IntArray) -> BoolArray:
    """Return places at a line's end that lie in a wider line which it joins, (n,)."""
    out = np.zeros(len(ways), dtype=np.bool_)
    at = ways.point[:, :2]
    reach = float(ways.width.max())
    one, other = cKDTree(at).query_pairs(reach, output_type="ndarray").T
    for thin, wide in ((one, other), (other, one)):
        apart = np.linalg.norm(at[thin] - at[wide], axis=1)
        inside = apart < 0.5 * ways.width[wide] + _RIM * ways.width[thin]
        wider = ways.width[wide] > _WIDER * ways.width[thin]
        out[thin[inside & wider & (line[thin] != line[wide])]] = True
    return out


def _sloped(
    presence: FloatArray, along: FloatArray, rows: BoolArray, own: BoolArray, usual: float
) -> FloatArray:
    """Level of one line's ink at its places ``rows``, learned at those of ``own``."""
    middle, size = float(along[rows].mean()), max(float(np.ptp(along[rows])), 1e-6)
    x = (along - middle) / size
    level = np.full(len(along), usual)
    for _ in range(_ROUNDS):
        near = own & (np.abs(presence - level) < _NEAR * level)
        if near.sum() < _FEWEST or np.ptp(x[near]) < 0.5:
            break
        slope, least = np.polyfit(x[near], presence[near], 1)
        level = least + slope * x
    return np.asarray(level[rows])


def among_lines(smooth: FloatImage, ways: Ways, seen: Seen, use: BoolArray) -> FloatArray:
    """Return the covariance (c, c) of what lines show in their middle, of places ``use`` (n,)."""
    count, middle, line = smooth.shape[2], np.zeros((1, 1)), lines_of(ways)
    at = np.stack(
        [seen.profiles(np.ascontiguousarray(smooth[:, :, c]), middle)[:, 0] for c in range(count)],
        axis=1,
    )
    usual = [np.median(at[use & (line == one)], axis=0) for one in np.unique(line[use])]
    if len(usual) < 2:
        return np.zeros((count, count))
    return np.atleast_2d(np.cov(np.array(usual, dtype=np.float64).T))
