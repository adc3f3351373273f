"""Trace streamlines of steady 3D flow through a lumen's elements."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.hemodynamics.three_d.lagrange import shapes
from design.hemodynamics.three_d.solution import Field
from kernels.arrays import FloatArray

_NEIGHBOURS: Final = 24
"""Elements looked into for a place, by their centres."""

_OUTSIDE: Final = -0.1
"""Barycentric coordinate below which a place is outside: curved walls bulge from straight ones."""

_STILL: Final = 1e-6
"""Of the greatest speed: a line ends there."""

_LINES, _MAX_STEPS = 200, 1500


def trace_streamlines(
    field: Field, seeds: FloatArray | None = None
) -> list[tuple[FloatArray, FloatArray]]:
    """Trace lines through places both ways, by midpoint steps of an element's size.

    Parameters
    ----------
    field : Field
    seeds : (n, 3) float64, mm, optional
        By default the centres of 200 elements, which are as many in thin vessels as in wide ones.

    Returns
    -------
    list of ((k, 3) float64, (k,) float64)
        Points along a line, mm, in the flow's direction, and the speed there, mm/s.
    """
    search = _Elements(field)
    if seeds is None:
        seeds = search.centre[:: max(1, len(search.centre) // _LINES)]
    back, ahead = (_half_lines(search, seeds, sign) for sign in (-1.0, 1.0))
    lines = [np.concatenate([back[:0:-1, k], ahead[:, k]]) for k in range(len(seeds))]
    lines = [line[np.isfinite(line[:, 3])] for line in lines]
    return [(line[:, :3], line[:, 3]) for line in lines if len(line) > 1]


def _half_lines(search: _Elements, seeds: FloatArray, sign: float) -> FloatArray:
    """Points and speed, (steps, n, 4), NaN beyond a line's end."""
    count, place = len(seeds), seeds.copy()
    going, steps = np.arange(count), list[FloatArray]()
    for _ in range(_MAX_STEPS):
        velocity, size, inside = search.velocity(place[going])
        speed = np.linalg.norm(velocity, axis=1)
        kept = inside & (speed > _STILL * search.fastest)
        going = going[kept]
        if not len(going):
            break
        here = np.full((count, 4), np.nan)
        here[going] = np.column_stack([place[going], speed[kept]])
        steps.append(here)
        step = (sign * size / np.where(speed > 0.0, speed, 1.0))[kept, None]
        middle = search.velocity(place[going] + 0.5 * step * velocity[kept])[0]
        length = np.linalg.norm(middle, axis=1, keepdims=True)
        place[going] += sign * size[kept, None] * middle / np.maximum(length, 1e-300)
    return np.array(steps).reshape(-1, count, 4)


class _Elements:
    """Elements by place; edges count as straight."""

    def __init__(self, field: Field) -> None:
        self._field = field
        corner = field.mesh.points[field.mesh.tets[:, :4]]
        edges = corner[:, 1:] - corner[:, :1]
        self._first, self._inverse = corner[:, 0], np.linalg.inv(edges)
        self._size = np.cbrt(np.abs(np.linalg.det(edges)) / 6.0)
        self.centre = corner.mean(axis=1)
        self._tree = cKDTree(self.centre)
        self.fastest = float(np.linalg.norm(field.velocity, axis=2).max())

    def velocity(self, points: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """Velocity (n, 3) at points, their elements' size (n,), and whether they lie in one."""
        near = self._tree.query(points, k=min(_NEIGHBOURS, len(self._size)))[1]
        near = near.reshape(len(points), -1)
        at = np.einsum("nkx,nkxa->nka", points[:, None] - self._first[near], self._inverse[near])
        at = np.concatenate([1.0 - at.sum(axis=2, keepdims=True), at], axis=2)
        row, best = np.arange(len(points)), at.min(axis=2).argmax(axis=1)
        tet, at = near[row, best], at[row, best]
        inside = at.min(axis=1) > _OUTSIDE
        at = np.clip(at, 0.0, None) / np.clip(at, 0.0, None).sum(axis=1, keepdims=True)
        value = shapes(self._field.order, at)[0]
        velocity = np.einsum("nq,nqx->nx", value, self._field.velocity[tet])
        return velocity, self._size[tet], inside
