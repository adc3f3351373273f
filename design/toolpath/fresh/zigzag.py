"""Infill lines written in one go: to and fro, joined along the wall where they turn.

Two neighbouring lines of width w, w apart, end on a wall, a distance L from each other. Both are
shortened by L/2 and joined by a line of length L and their width. The volume stays: each loses
w L/2. The joint is parallel to the wall's chord and w/2 inside it, as a line along it would be.
Between widths v < w the joint is v wide and both are shortened by s = L v / (v + w). Where a whole
line goes on as a half one, h beside it and in the same direction, L² = h² + 4 s².
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.toolpath.fresh.cells import Cells, crossing
from design.toolpath.fresh.order import Sequence
from design.toolpath.fresh.paths import Paths, Role, join
from design.toolpath.toolpath import FloatArray, IntArray

#: Lines further apart than so many widths aren't joined: the joint would stand off the wall.
FURTHEST = 1.3
#: What must be left of a line between its joints, in widths.
LEAST_LEFT = 0.5
#: Least cosine between the directions of two lines of one direction.
PARALLEL = 0.9999
#: Greatest share of the narrower of two widths in both; equal ones have no joint going on.
UNEQUAL = 0.4


@dataclass(frozen=True)
class _Written:
    """Infill paths in the order and the direction of writing; as in `Paths`."""

    points: FloatArray
    width_mm: FloatArray
    offset: IntArray


def zigzag(
    paths: Paths, sequence: Sequence, obstacle: Cells, joint_mm: float
) -> tuple[Paths, Sequence]:
    """Join straight infill lines that follow one another into zig-zags.

    Parameters
    ----------
    paths : Paths
    sequence : Sequence
        Infill last.
    obstacle : Cells
        Contours that no joint may cross.
    joint_mm : float, mm
        Longest joint.
    """
    fills = paths.role[sequence.path] == Role.INFILL
    lines = sequence.path[fills]
    if len(lines) < 2:
        return paths, sequence
    joined = _joined(_as_written(paths, lines, sequence.backward[fills]), obstacle, joint_mm)
    count, shift = len(joined.offset) - 1, len(paths.points)
    made = Paths(
        joined.points,
        joined.width_mm,
        joined.offset,
        np.zeros(count, dtype=np.bool_),
        np.full(count, int(Role.INFILL), dtype=np.int64),
        np.zeros(count, dtype=np.int64),
    )
    rest = Sequence(sequence.path[~fills], sequence.first[~fills], sequence.backward[~fills])
    chains = Sequence(
        len(paths) + np.arange(count),
        shift + joined.offset[:-1],
        np.zeros(count, dtype=np.bool_),
    )
    return join([paths, made]), rest.then(chains)


def _as_written(paths: Paths, lines: IntArray, backward: NDArray[np.bool_]) -> _Written:
    low, size = paths.offset[lines], np.diff(paths.offset)[lines]
    offset = np.concatenate([[0], np.cumsum(size)])
    step = np.arange(offset[-1]) - np.repeat(offset[:-1], size)
    turned = np.repeat(backward, size)
    first = np.repeat(np.where(backward, low + size - 1, low), size)
    place = np.where(turned, first - step, first + step)
    # A width belongs to the line that comes to a point; a path's first has none.
    comes = np.where(turned & (step > 0), place + 1, place)
    return _Written(paths.points[place], paths.width_mm[comes], offset)


def _joined(lines: _Written, obstacle: Cells, joint_mm: float) -> _Written:
    first, last = lines.offset[:-1], lines.offset[1:] - 1
    shorter, along = _joints(lines, obstacle, joint_mm)
    points, width = lines.points.copy(), lines.width_mm.copy()
    points[last[:-1]] -= shorter[:, None] * along[:-1]
    points[first[1:]] += shorter[:, None] * along[1:]
    joints = shorter > 0
    least = np.minimum(width[last[:-1]], width[last[1:]])
    width[first[1:][joints]] = least[joints]
    keep = np.concatenate([[True], ~joints, [True]])
    return _Written(points, width, lines.offset[keep])


def _joints(lines: _Written, obstacle: Cells, joint_mm: float) -> tuple[FloatArray, FloatArray]:
    """By how much each line and the next one are shortened, mm, 0 for no joint; directions."""
    first, last = lines.offset[:-1], lines.offset[1:] - 1
    way = lines.points[last] - lines.points[first]
    length = np.hypot(way[:, 0], way[:, 1])
    along = way / np.maximum(length, 1e-12)[:, None]
    straight, width = last - first == 1, lines.width_mm[last]
    gap = lines.points[first[1:]] - lines.points[last[:-1]]
    before, after = along[:-1], along[1:]
    apart = np.abs(before[:, 0] * gap[:, 1] - before[:, 1] * gap[:, 0])
    beside = np.abs((before * gap).sum(axis=1))
    joint = np.hypot(gap[:, 0], gap[:, 1])
    least, most = np.minimum(width[:-1], width[1:]), np.maximum(width[:-1], width[1:])
    share = least / (width[:-1] + width[1:])
    cosine = (before * after).sum(axis=1)
    near = straight[:-1] & straight[1:] & (joint <= joint_mm) & (apart > 0)
    turns = near & (cosine < -PARALLEL) & (apart <= FURTHEST * most)
    turns &= beside < np.minimum(length[:-1], length[1:])
    goes_on = near & (cosine > PARALLEL) & (apart < least) & (beside < 1e-6 * most)
    goes_on &= share < UNEQUAL
    onward = share * joint / np.sqrt(1 - 4 * np.minimum(share, UNEQUAL) ** 2)
    shorter = np.where(turns, share * joint, np.where(goes_on, onward, 0.0))
    fits = turns | goes_on
    rows = np.flatnonzero(fits)
    begin = lines.points[last[rows]] - shorter[rows, None] * before[rows]
    end = lines.points[first[rows + 1]] + shorter[rows, None] * after[rows]
    shorter[rows[crossing(begin, end, obstacle)]] = 0.0
    return _with_room(shorter, length, LEAST_LEFT * width), along


def _with_room(shorter: FloatArray, length: FloatArray, least: FloatArray) -> FloatArray:
    """Give up joints until ``least`` is left of each line, the one after a line first."""
    while True:
        taken = np.concatenate([[0.0], shorter]) + np.concatenate([shorter, [0.0]])
        short = np.flatnonzero((length - taken < least) & (taken > 0))
        if len(short) == 0:
            return shorter
        follows = np.minimum(short, len(shorter) - 1)
        after = (short < len(shorter)) & (shorter[follows] > 0)
        shorter[np.where(after, follows, short - 1)] = 0.0
