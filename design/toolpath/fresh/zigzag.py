"""Join infill lines to continuous zig-zags, with turns along the wall.

Two neighbouring lines of width w, w apart, end on a wall, a distance L from each other. Both are
shortened by s and joined by a line of length L, v wide; s = L v / 2 w leaves the volume as it is.
The joint is parallel to the wall's chord and v/2 inside it, as a line along it would be. It is half
as wide as the lines: the nearer these come to the wall, the less of the corners beside their round
ends stays empty, s³/3 w of each (0.6 % of a block with joints as wide as the lines). Between widths
u < w both are shortened by s = L v / (u + w). Where a whole line goes on as a half one beside it,
in the same direction, the half one begins as a ramp, long enough not to be merged (`_ramp`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.toolpath.fresh.cells import Cells, crossing
from design.toolpath.fresh.order import Sequence
from design.toolpath.fresh.paths import Paths, Role, join
from kernels.arrays import FloatArray, IntArray

#: Lines further apart than so many widths aren't joined: the joint would stand off the wall.
FURTHEST = 1.3
#: Width of a joint, in widths of the widest line; no wider than the narrower of two that it joins.
THINNER = 0.5
#: What must be left of a line between its joints, in widths.
LEAST_LEFT = 0.5
#: Least cosine between the directions of two lines of one direction.
PARALLEL = 0.9999
#: Greatest ratio of a line's width to another's that it goes on as.
UNEQUAL = 0.67


@dataclass(frozen=True)
class _Joints:
    """What could join each line to the next, (n - 1,) each.

    Attributes
    ----------
    made : bool
    before, after : float64, mm
        By how much the line and the next one are shortened.
    width_mm : float64, mm
    """

    made: NDArray[np.bool_]
    before: FloatArray
    after: FloatArray
    width_mm: FloatArray


def zigzag(
    paths: Paths, sequence: Sequence, obstacle: Cells, joint_mm: float, least_mm: float = 0.0
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
    least_mm : float, mm
        Shortest move, along the longer of x and y, that the firmware doesn't merge: what is left of
        a line, and a joint, are as long.
    """
    fills = paths.role[sequence.path] == Role.INFILL
    lines = sequence.path[fills]
    if len(lines) < 2:
        return paths, sequence
    made = _joined(
        _as_written(paths, lines, sequence.backward[fills]), obstacle, joint_mm, least_mm
    )
    count, shift = len(made), len(paths.points)
    rest = Sequence(sequence.path[~fills], sequence.first[~fills], sequence.backward[~fills])
    chains = Sequence(
        len(paths) + np.arange(count),
        shift + made.offset[:-1],
        np.zeros(count, dtype=np.bool_),
    )
    return join([paths, made]), rest.then(chains)


def _infill(points: FloatArray, width_mm: FloatArray, offset: IntArray) -> Paths:
    """Open paths in the order and the direction of writing."""
    count = len(offset) - 1
    role, level = np.full(count, int(Role.INFILL), dtype=np.int64), np.zeros(count, dtype=np.int64)
    return Paths(points, width_mm, offset, np.zeros(count, dtype=np.bool_), role, level)


def _as_written(paths: Paths, lines: IntArray, backward: NDArray[np.bool_]) -> Paths:
    low, size = paths.offset[lines], np.diff(paths.offset)[lines]
    offset = np.concatenate([[0], np.cumsum(size)])
    step = np.arange(offset[-1]) - np.repeat(offset[:-1], size)
    turned = np.repeat(backward, size)
    first = np.repeat(np.where(backward, low + size - 1, low), size)
    place = np.where(turned, first - step, first + step)
    # A width belongs to the line that comes to a point; a path's first has none.
    comes = np.where(turned & (step > 0), place + 1, place)
    return _infill(paths.points[place], paths.width_mm[comes], offset)


def _joined(lines: Paths, obstacle: Cells, joint_mm: float, least_mm: float) -> Paths:
    first, last = lines.offset[:-1], lines.offset[1:] - 1
    joints = _joints(lines, joint_mm, least_mm)
    along = _along(lines)
    begin = lines.points[last[:-1]] - joints.before[:, None] * along[:-1]
    end = lines.points[first[1:]] + joints.after[:, None] * along[1:]
    rows = np.flatnonzero(joints.made)
    made = joints.made.copy()
    made[rows[crossing(begin[rows], end[rows], obstacle)]] = False
    made = _with_room(joints, made, _length(lines), _least_left(lines, along, least_mm))
    points, width = lines.points.copy(), lines.width_mm.copy()
    points[last[:-1][made]], points[first[1:][made]] = begin[made], end[made]
    width[first[1:][made]] = joints.width_mm[made]
    return _infill(points, width, lines.offset[np.concatenate([[True], ~made, [True]])])


def _length(lines: Paths) -> FloatArray:
    way = lines.points[lines.offset[1:] - 1] - lines.points[lines.offset[:-1]]
    return np.asarray(np.hypot(way[:, 0], way[:, 1]))


def _along(lines: Paths) -> FloatArray:
    way = lines.points[lines.offset[1:] - 1] - lines.points[lines.offset[:-1]]
    return np.asarray(way / np.maximum(_length(lines), 1e-12)[:, None])


def _least_left(lines: Paths, along: FloatArray, least_mm: float) -> FloatArray:
    """What must be left of each line: a move that isn't merged with the one after it."""
    axis = np.maximum(np.abs(along).max(axis=1), np.sqrt(0.5))
    return np.maximum(LEAST_LEFT * lines.width_mm[lines.offset[1:] - 1], least_mm / axis)


def _joints(lines: Paths, joint_mm: float, least_mm: float) -> _Joints:
    """Joints between each line and the next one."""
    first, last = lines.offset[:-1], lines.offset[1:] - 1
    along, length = _along(lines), _length(lines)
    straight, width = last - first == 1, lines.width_mm[last]
    gap = lines.points[first[1:]] - lines.points[last[:-1]]
    ahead, behind = along[:-1], along[1:]
    apart = np.abs(ahead[:, 0] * gap[:, 1] - ahead[:, 1] * gap[:, 0])
    beside = np.abs((ahead * gap).sum(axis=1))
    joint = np.hypot(gap[:, 0], gap[:, 1])
    narrow, most = np.minimum(width[:-1], width[1:]), np.maximum(width[:-1], width[1:])
    wide = np.minimum(narrow, THINNER * width.max())
    cosine = (ahead * behind).sum(axis=1)
    near = straight[:-1] & straight[1:] & (joint <= joint_mm) & (apart > 0)
    turns = near & (cosine < -PARALLEL) & (apart <= FURTHEST * most)
    turns &= beside < np.minimum(length[:-1], length[1:])
    goes_on = near & (cosine > PARALLEL) & (apart < narrow) & (beside < 1e-6 * most)
    goes_on &= narrow < UNEQUAL * most
    turned = wide * joint / (width[:-1] + width[1:])
    before, after = _ramp(width, apart, _least_left(lines, along, least_mm))
    return _Joints(
        turns | goes_on,
        np.where(turns, turned, before),
        np.where(turns, turned, after),
        np.where(turns, wide, narrow),
    )


def _ramp(width: FloatArray, apart: FloatArray, way: FloatArray) -> tuple[FloatArray, FloatArray]:
    """By how much two lines of one direction are shortened for a joint as the narrower one, mm.

    The joint takes ``way`` b of the narrower line, of width v, and a of the wider one, k v wide:
    k a + b = L and L² = h² + (a + b)².
    """
    thin = width[:-1] < width[1:]
    ratio = np.where(thin, width[1:] / width[:-1], width[:-1] / width[1:])
    b = np.where(thin, way[:-1], way[1:])
    more = np.maximum(ratio - 1, 1e-12)
    a = (np.sqrt((b * more) ** 2 + more * (ratio + 1) * apart**2) - b * more) / (more * (ratio + 1))
    return np.where(thin, b, a), np.where(thin, a, b)


def _with_room(
    joints: _Joints, made: NDArray[np.bool_], length: FloatArray, least: FloatArray
) -> NDArray[np.bool_]:
    """Give up joints until ``least`` is left of each line, the one after a line first."""
    made = made.copy()
    while True:
        before = np.append(np.where(made, joints.before, 0.0), 0.0)
        after = np.concatenate([[0.0], np.where(made, joints.after, 0.0)])
        short = np.flatnonzero((length - before - after < least) & (before + after > 0))
        if len(short) == 0:
            return made
        follows = np.minimum(short, len(made) - 1)
        made[np.where((short < len(made)) & made[follows], follows, short - 1)] = False
