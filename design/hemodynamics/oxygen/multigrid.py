"""Precondition the oxygen solver's linear system by a multigrid V-cycle on the tissue grid."""

from __future__ import annotations

from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from design.hemodynamics.oxygen.tissue_grid import TissueGrid
from kernels import jit
from kernels.arrays import FloatArray


class CycleLimits(NamedTuple):
    """Shape of the V-cycle: one sweep down and one up on every level but the coarsest."""

    coarsest_sweeps: int = 60
    """Of Gauss-Seidel, over at most 125 cells."""
    coarsest_cells: int = 5
    """Along the longest side of the coarsest level."""


CYCLE: Final = CycleLimits()


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
        value[:] = 0.0
        if depth == len(self.levels) - 1:
            for sweep in range(CYCLE.coarsest_sweeps):
                relax(level, given, value, sweep % 2 == 1)
            return value
        relax(level, given, value, False)
        apply(level, value, rest)
        np.subtract(given, rest, out=rest)
        add_eight(rest, self._given[depth])
        correction = self._cycle(depth + 1, self._given[depth])
        add_between(correction, self.levels[depth + 1].own, value)
        relax(level, given, value, True)
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


class Level(NamedTuple):
    """Conductances of one grid, in µL/s; all arrays have a layer of empty cells all round.

    A cell gives to its neighbour D h (c - c'), the finite volume of a cube; between tissue and
    anything else nothing passes. Coarse cells are eight fine ones; their faces conduct half of what
    the fine faces between them do together, since the way is twice as long (cell-centred multigrid,
    Wesseling 1988, J Comput Phys 79, 85).

    Attributes
    ----------
    east, north, up : (nx, ny, nz) float32
        Of the face to the next cell in x, y and z.
    own : (nx, ny, nz) float64
        What each cell loses per concentration besides; changes from one Newton step to the next.
    """

    east: np.ndarray
    north: np.ndarray
    up: np.ndarray
    own: FloatArray


def finest_level(grid: TissueGrid, diffusivity: float) -> Level:
    """Faces between cells of the tissue, and nothing lost."""
    conductance = np.float32(diffusivity * grid.spacing_mm)
    faces = []
    for axis in range(3):
        face = np.zeros(grid.inside.shape, dtype=np.float32)
        low = tuple(slice(0, -1) if a == axis else slice(None) for a in range(3))
        high = tuple(slice(1, None) if a == axis else slice(None) for a in range(3))
        face[low] = conductance * (grid.inside[low] & grid.inside[high])
        faces.append(face)
    return Level(faces[0], faces[1], faces[2], np.zeros(grid.inside.shape))


def bath_conductance(grid: TissueGrid, diffusivity: float) -> FloatArray:
    """From each cell to the bath beyond the tissue's surface, (nx, ny, nz), µL/s.

    Through each face to an empty cell, over the cell's depth below the surface: a quarter of the
    spacing at least, since rounding aside the staircase's cells are that deep or deeper.
    """
    h, bare = grid.spacing_mm, np.zeros(grid.inside.shape)
    for axis in range(3):
        for step in (-1, 1):
            bare += grid.inside & ~np.roll(grid.inside, step, axis=axis)
    # Below a surface aslant to the axes a cell shows it several faces for the one it has.
    return bare * diffusivity * h * h / np.clip(grid.depth_mm, 0.25 * h, h)


def coarser(level: Level) -> list[Level]:
    """``level`` and its coarser ones, down to a few cells, whose ``own`` is still 0."""
    levels = [level]
    while max(levels[-1].own.shape) > CYCLE.coarsest_cells + 2:
        fine = levels[-1]
        shape = tuple((n - 2 + 1) // 2 + 2 for n in fine.own.shape)
        east, north, up = np.zeros((3, *shape), dtype=np.float32)
        levels.append(Level(east, north, up, np.zeros(shape)))
        _coarsen(fine, levels[-1])
    return levels


def restrict_losses(levels: list[Level]) -> None:
    """Give each coarse cell what its eight lose."""
    for fine, coarse in pairwise(levels):
        add_eight(fine.own, coarse.own)


@jit
def _coarsen(fine: Level, coarse: Level) -> None:
    nx, ny, nz = fine.east.shape
    for i in range(1, nx - 1):
        for j in range(1, ny - 1):
            for k in range(1, nz - 1):
                a, b, c = (i + 1) // 2, (j + 1) // 2, (k + 1) // 2
                if i % 2 == 0:
                    coarse.east[a, b, c] += np.float32(0.5) * fine.east[i, j, k]
                if j % 2 == 0:
                    coarse.north[a, b, c] += np.float32(0.5) * fine.north[i, j, k]
                if k % 2 == 0:
                    coarse.up[a, b, c] += np.float32(0.5) * fine.up[i, j, k]


@jit
def add_eight(fine: FloatArray, coarse: FloatArray) -> None:
    """Sum of eight cells each into the coarse one."""
    nx, ny, nz = fine.shape
    coarse[:] = 0.0
    for i in range(1, nx - 1):
        for j in range(1, ny - 1):
            for k in range(1, nz - 1):
                coarse[(i + 1) // 2, (j + 1) // 2, (k + 1) // 2] += fine[i, j, k]


@jit
def apply(level: Level, c: FloatArray, out: FloatArray) -> None:
    """What each cell loses, nmol/s, into ``out``; its outer layer stays as it is."""
    east, north, up, own = level
    nx, ny, nz = c.shape
    for i in range(1, nx - 1):
        for j in range(1, ny - 1):
            for k in range(1, nz - 1):
                here = c[i, j, k]
                out[i, j, k] = (
                    own[i, j, k] * here
                    + east[i, j, k] * (here - c[i + 1, j, k])
                    + east[i - 1, j, k] * (here - c[i - 1, j, k])
                    + north[i, j, k] * (here - c[i, j + 1, k])
                    + north[i, j - 1, k] * (here - c[i, j - 1, k])
                    + up[i, j, k] * (here - c[i, j, k + 1])
                    + up[i, j, k - 1] * (here - c[i, j, k - 1])
                )


@jit
def relax(level: Level, given: FloatArray, c: FloatArray, backward: bool) -> None:
    """One sweep of Gauss-Seidel in place, forward or backward."""
    east, north, up, own = level
    nx, ny, nz = c.shape
    for a in range(1, nx - 1):
        i = nx - 1 - a if backward else a
        for b in range(1, ny - 1):
            j = ny - 1 - b if backward else b
            for d in range(1, nz - 1):
                k = nz - 1 - d if backward else d
                e, w = east[i, j, k], east[i - 1, j, k]
                n, s = north[i, j, k], north[i, j - 1, k]
                u, v = up[i, j, k], up[i, j, k - 1]
                diagonal = own[i, j, k] + (e + w + n + s + u + v)
                if diagonal > 0.0:
                    c[i, j, k] = (
                        given[i, j, k]
                        + e * c[i + 1, j, k] + w * c[i - 1, j, k]
                        + n * c[i, j + 1, k] + s * c[i, j - 1, k]
                        + u * c[i, j, k + 1] + v * c[i, j, k - 1]
                    ) / diagonal  # fmt: skip
