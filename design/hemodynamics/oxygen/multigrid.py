"""Precondition the oxygen solver's linear system by a multigrid V-cycle on the tissue grid."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.hemodynamics.oxygen.levels import Level, add_eight, apply, relax
from kernels import jit
from kernels.arrays import FloatArray

_SWEEPS: Final = 1
_ON_THE_COARSEST: Final = 60


class VCycle:
    """V-cycles on given levels; holds their scratch arrays.

    Parameters
    ----------
    levels : list of Level
        From fine to coarse.

    Attributes
    ----------
    count : int
        Cycles made.
    """

    def __init__(self, levels: list[Level]) -> None:
        self.levels, self.count = levels, 0
        self._value = [np.zeros(level.own.shape) for level in levels]
        self._given = [np.zeros(level.own.shape) for level in levels[1:]]
        self._rest = [np.zeros(level.own.shape) for level in levels]

    def __call__(self, given: FloatArray) -> FloatArray:
        """Return approximately what loses ``given``; a fresh array of its shape."""
        self.count += 1
        return self._cycle(0, given.reshape(self.levels[0].own.shape)).copy().reshape(given.shape)

    def _cycle(self, depth: int, given: FloatArray) -> FloatArray:
        level, value, rest = self.levels[depth], self._value[depth], self._rest[depth]
        faces = (level.east, level.north, level.up, level.own)
        value[:] = 0.0
        if depth == len(self.levels) - 1:
            for sweep in range(_ON_THE_COARSEST):
                relax(*faces, given, value, sweep % 2 == 1)
            return value
        for _ in range(_SWEEPS):
            relax(*faces, given, value, False)
        apply(*faces, value, rest)
        np.subtract(given, rest, out=rest)
        add_eight(rest, self._given[depth])
        correction = self._cycle(depth + 1, self._given[depth])
        add_between(correction, self.levels[depth + 1].own, value)
        for _ in range(_SWEEPS):
            relax(*faces, given, value, True)
        return value


@jit
def add_between(coarse: FloatArray, inside: FloatArray, fine: FloatArray) -> None:
    """Add a coarse field, trilinear between the middles of its cells that hold tissue.

    ``inside`` is above 0 in those; where all eight are outside nothing is added.
    """
    nx, ny, nz = fine.shape
    for i in range(1, nx - 1):
        a = (i + 1) // 2
        a2 = a - 1 if i % 2 == 1 else a + 1
        for j in range(1, ny - 1):
            b = (j + 1) // 2
            b2 = b - 1 if j % 2 == 1 else b + 1
            for k in range(1, nz - 1):
                c = (k + 1) // 2
                c2 = c - 1 if k % 2 == 1 else c + 1
                total, weight = 0.0, 0.0
                for p in range(8):
                    x, y, z = a, b, c
                    w = 27.0
                    if p & 1:
                        x, w = a2, w / 3.0
                    if p & 2:
                        y, w = b2, w / 3.0
                    if p & 4:
                        z, w = c2, w / 3.0
                    if inside[x, y, z] > 0.0:
                        total += w * coarse[x, y, z]
                        weight += w
                if weight > 0.0:
                    fine[i, j, k] += total / weight
