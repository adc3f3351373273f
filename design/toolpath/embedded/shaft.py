"""Which piece's writing would drive the shaft through which other piece.

The needle is vertical: with the tip at b, the shaft fills the cylinder of radius R (outer radius
plus clearance) above b. A filament sample a of radius r is hit when its horizontal distance to b
is below R + r and its top, z_a + r, is above the tip.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from design.toolpath.embedded.pieces import Piece
from design.toolpath.toolpath import FloatArray, IntArray
from kernels import jit

#: Upper bound of the search grid's size, cells.
MAX_CELLS = 4_000_000


@dataclass(frozen=True)
class Conflicts:
    """Rules of order: ``first`` before ``second``, or harm is done.

    Attributes
    ----------
    first, second : (m,) int64
        Pieces; writing `first` after `second` drives the shaft through `second`.
    harm_mm : (m,) float64, mm
        Length of `first` along which it does.
    own_mm : (n,) float64, mm
        Length of each piece along which the shaft passes through the piece itself.
    """

    first: IntArray
    second: IntArray
    harm_mm: FloatArray
    own_mm: FloatArray


class Samples(NamedTuple):
    """Points along all pieces, those of a piece together.

    Position, radius, arc length from the piece's start, the length that each stands for, and the
    piece.
    """

    point: FloatArray
    radius: FloatArray
    arc: FloatArray
    step: FloatArray
    piece: IntArray


class Grid(NamedTuple):
    """Samples by square of the plan.

    Each one's column and row, and the members of square (column · rows + row) as
    ``member[begin[square]:begin[square + 1]]``.
    """

    place: IntArray
    shape: IntArray
    begin: IntArray
    member: IntArray


class Needle(NamedTuple):
    """Radius that the shaft needs, mm, and how many radii joints overlap."""

    shaft: float
    overlap_radii: float


class Ends(NamedTuple):
    """Of each piece, the nodes at its ends (n, 2) and where they are (n, 2, 3)."""

    node: IntArray
    corner: FloatArray


@jit
def _squared(a: FloatArray, b: FloatArray) -> float:
    total: float = (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
    return total


@jit
def _in_joint(a: FloatArray, b: FloatArray, p: int, q: int, reach: float, ends: Ends) -> bool:
    """Whether both points lie within ``reach`` of a node that the pieces share."""
    for i in range(2):
        for j in range(2):
            if ends.node[p, i] == ends.node[q, j]:
                corner = ends.corner[p, i]
                if max(_squared(a, corner), _squared(b, corner)) < reach * reach:
                    return True
    return False


@jit
def _is_spared(s: int, t: int, samples: Samples, ends: Ends, needle: Needle) -> bool:
    """Whether the shaft above sample s may touch sample t."""
    radius = max(samples.radius[t], samples.radius[s])
    reach = np.sqrt(2.0) * (needle.shaft + radius) + needle.overlap_radii * radius
    p, q = samples.piece[s], samples.piece[t]
    if p == q:
        # What comes later isn't written yet, and what was written just before is still fresh.
        own: bool = samples.arc[t] + reach >= samples.arc[s]
        return own
    return _in_joint(samples.point[t], samples.point[s], p, q, reach, ends)


@jit
def _harm(
    low: int, high: int, samples: Samples, grid: Grid, ends: Ends, needle: Needle
) -> FloatArray:
    """Length of one piece, samples low to high, along which the shaft hits each piece, (n,)."""
    # Bound to plain names, and the plan tested before any call: both are the hot loop's speed.
    point, radius, piece, member = samples.point, samples.radius, samples.piece, grid.member
    shaft = needle.shaft
    harm, seen = np.zeros(len(ends.node)), np.full(len(ends.node), -1)
    for s in range(low, high):
        bx, by, bz = point[s, 0], point[s, 1], point[s, 2]
        column, row = grid.place[s, 0], grid.place[s, 1]
        for x in range(max(0, column - 1), min(grid.shape[0], column + 2)):
            for y in range(max(0, row - 1), min(grid.shape[1], row + 2)):
                square = x * grid.shape[1] + y
                for m in range(grid.begin[square], grid.begin[square + 1]):
                    t = member[m]
                    if point[t, 2] + radius[t] <= bz or seen[piece[t]] == s:
                        continue
                    gap = (point[t, 0] - bx) ** 2 + (point[t, 1] - by) ** 2
                    if gap >= (shaft + radius[t]) ** 2:
                        continue
                    if not _is_spared(s, t, samples, ends, needle):
                        seen[piece[t]] = s
                        harm[piece[t]] += samples.step[s]
    return harm


def find_conflicts(
    pieces: list[Piece], needle: Needle, paths: list[Piece] | None = None
) -> Conflicts:
    """Find every pair of pieces whose order matters.

    Pieces are compared by samples half a shaft radius R apart; a grazing touch may be missed by
    at most R/16, which the clearance covers. Where two pieces meet, what lies within √2 (R + r)
    and the overlap of the node is the joint and is spared, and so is that length behind the tip
    along a piece: slopes of up to 45° may join and be written downward.

    Parameters
    ----------
    pieces : list of Piece
        With their ends on the nodes.
    needle : Needle
    paths : list of Piece
        The same pieces as they are written, overlaps included; `pieces` where not given.
    """
    samples, begin = _sampled(paths or pieces, needle.shaft / 2)
    grid = _grid(samples, needle.shaft)
    ends = Ends(
        np.array([piece.ends for piece in pieces], dtype=np.int64),
        np.array([piece.points[[0, -1]] for piece in pieces]),
    )
    own, second, amount = np.zeros(len(pieces)), [], []
    for p in range(len(pieces)):
        harm = _harm(begin[p], begin[p + 1], samples, grid, ends, needle)
        own[p], harm[p] = harm[p], 0.0
        second.append(np.flatnonzero(harm))
        amount.append(harm[second[-1]])
    first = np.repeat(np.arange(len(pieces)), [len(found) for found in second])
    return Conflicts(first, np.concatenate(second), np.concatenate(amount), own)


def _sampled(pieces: list[Piece], spacing_mm: float) -> tuple[Samples, IntArray]:
    """Samples of all pieces, and where each piece's begin, (n + 1,)."""
    parts = [_along(piece, spacing_mm) for piece in pieces]
    count = np.array([len(radius) for _, radius, _, _ in parts])
    samples = Samples(
        np.concatenate([part[0] for part in parts]),
        np.concatenate([part[1] for part in parts]),
        np.concatenate([part[2] for part in parts]),
        np.concatenate([part[3] for part in parts]),
        np.repeat(np.arange(len(pieces)), count),
    )
    return samples, np.concatenate([[0], np.cumsum(count)])


def _along(piece: Piece, spacing_mm: float) -> tuple[FloatArray, ...]:
    steps = np.linalg.norm(np.diff(piece.points, axis=0), axis=1)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, arc[-1], int(np.ceil(arc[-1] / spacing_mm)) + 1)
    points = np.column_stack([np.interp(at, arc, piece.points[:, axis]) for axis in range(3)])
    return points, np.interp(at, arc, piece.radius), at, np.full(len(at), arc[-1] / len(at))


def _grid(samples: Samples, shaft_mm: float) -> Grid:
    plan = samples.point[:, :2] - samples.point[:, :2].min(axis=0)
    size = plan.max(axis=0)
    pitch = max(shaft_mm + samples.radius.max(), float(np.sqrt(size.prod() / MAX_CELLS)))
    place = np.floor(plan / pitch).astype(np.int64)
    shape = place.max(axis=0) + 1
    square = place[:, 0] * shape[1] + place[:, 1]
    count = np.bincount(square, minlength=int(shape.prod()))
    begin = np.concatenate([[0], np.cumsum(count)])
    return Grid(place, shape, begin, np.argsort(square, kind="stable"))
