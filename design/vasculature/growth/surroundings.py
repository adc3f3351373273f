"""Obstacles to a growing tree (vessels of other trees), and its own territory in the tissue."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.vasculature.growth.clearances import Clearances
from design.vasculature.growth.fit import growth_factor, seven_integers
from design.vasculature.growth.index import CellIndex
from design.vasculature.growth.state import SEGMENT
from kernels import jit
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class Surroundings:
    """Vessels that a growing tree keeps clear of, and its territory.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
        Axes of the others' vessels.
    radius : (n,) float64, mm
    owns : function of (k, 3) float64 to (k,) bool, optional
        Which points lie in the territory; all by default.
    share : float
        Of the tissue's volume, and so of its flow, that the territory has.
    """

    start: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    end: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    radius: FloatArray = field(default_factory=lambda: np.empty(0))
    owns: Callable[[FloatArray], NDArray[np.bool_]] | None = None
    share: float = 1.0

    @property
    def count(self) -> int:
        """Vessels of others."""
        return len(self.radius)

    def records(self) -> NDArray[np.void]:
        """The vessels as records of a growing tree that feed nothing and take no branch."""
        records = np.zeros(self.count, SEGMENT)
        for axis, names in enumerate((("px", "dx"), ("py", "dy"), ("pz", "dz"))):
            records[names[0]], records[names[1]] = self.start[:, axis], self.end[:, axis]
        records["radius"], records["full"], records["allowed"] = self.radius, 1, np.inf
        for name in ("parent", "left", "right"):
            records[name] = -1
        return records


@jit
def clear_of(
    segments: Any, index: CellIndex, room: Clearances, begin: Any, points: Any, radius: float
) -> Any:
    """Whether capsules from ``begin`` (3,) to each of ``points`` (n, 3) clear all that is listed.

    The index must list the vessels of others alone.
    """
    free = np.zeros(len(points), np.bool_)
    skip = seven_integers(-1, -1, -1, -1, -1, -1, -1)
    for n in range(len(points)):
        t = points[n]
        x, y, z = begin[0], begin[1], begin[2]
        least = growth_factor(index, segments, room, x, y, z, t[0], t[1], t[2], radius, skip, False)
        free[n] = least >= room.reserve
    return free
