"""Data class of one layer's paths as flat arrays: points, line widths, role; join several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray


class Role(IntEnum):
    """What a path is for, in the order of writing."""

    WALL = 0
    """Along a boundary; walls nearer to it come first."""
    GAP = 1
    """In a place too thin for a wall."""
    INFILL = 2
    """Inside the walls."""


@dataclass(frozen=True)
class Paths:
    """Paths, each a run of points.

    Attributes
    ----------
    points : (n, 2) float64, mm
    width_mm : (n,) float64, mm
        Of the line that comes to each point; of a closed path's first point, of the line from
        its last.
    offset : (m + 1,) int64
        Path k is ``points[offset[k] : offset[k + 1]]``.
    closed : (m,) bool
        Closed paths don't repeat their first point and may begin anywhere.
    role, level : (m,) int64
        A `Role` each, and the wall's number counted from the boundary.
    """

    points: FloatArray
    width_mm: FloatArray
    offset: IntArray
    closed: NDArray[np.bool_]
    role: IntArray
    level: IntArray

    def __len__(self) -> int:
        return len(self.closed)


def gather(
    lines: Sequence[FloatArray],
    widths: Sequence[FloatArray],
    *,
    closed: bool,
    role: Role,
    level: int = 0,
) -> Paths:
    """Paths of one role from arrays of points (k, 2) and widths (k,)."""
    count = len(lines)
    return Paths(
        np.concatenate([np.zeros((0, 2)), *lines]),
        np.concatenate([np.zeros(0), *widths]),
        np.cumsum([0, *map(len, lines)], dtype=np.int64),
        np.full(count, closed),
        np.full(count, int(role), dtype=np.int64),
        np.full(count, level, dtype=np.int64),
    )


def join(parts: Sequence[Paths]) -> Paths:
    """All paths, in the order given."""
    shift = np.cumsum([0, *(len(part.points) for part in parts)])
    offsets = [part.offset[1:] + low for part, low in zip(parts, shift[:-1], strict=True)]
    return Paths(
        np.concatenate([np.zeros((0, 2)), *(part.points for part in parts)]),
        np.concatenate([np.zeros(0), *(part.width_mm for part in parts)]),
        np.concatenate([np.zeros(1, dtype=np.int64), *offsets]),
        np.concatenate([np.zeros(0, dtype=np.bool_), *(part.closed for part in parts)]),
        np.concatenate([np.zeros(0, dtype=np.int64), *(part.role for part in parts)]),
        np.concatenate([np.zeros(0, dtype=np.int64), *(part.level for part in parts)]),
    )
