"""Flow and pressure through cross-sections, read from a VTU file alone.

Reads with meshio and interpolates by itself: it shares nothing with what wrote the file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

FloatArray = NDArray[np.float64]

_NEAR = 60
_STEPS = 12
_INSIDE = 1e-6


class VtuFlow:
    """A file's mesh, velocity and pressure."""

    def __init__(self, path: Path) -> None:
        found = meshio.read(path)
        self.points = np.asarray(found.points, dtype=np.float64)
        self.cells = found.cells_dict["tetra10"]
        names = {name.lower(): name for name in found.point_data}
        self.velocity = found.point_data[next(names[n] for n in names if n.startswith("velocity"))]
        self.pressure = found.point_data[next(names[n] for n in names if n.startswith("pressure"))]
        self.tree = cKDTree(self.points[self.cells[:, :4]].mean(axis=1))

    def section(self, centre: FloatArray, along: FloatArray, radius: float) -> tuple[float, float]:
        """Flow through the disc (µL/s) and mean pressure (Pa) over it, by Gauss's places."""
        places, weights = _disc(centre, along, radius)
        inside, weight = self._weights(places)
        weights = np.where(inside, weights, 0.0)
        speed = np.einsum("pn,pnk,k->p", weight, self.velocity[self.found], along)
        pressure = np.einsum("pn,pn->p", weight, self.pressure.reshape(-1)[self.found])
        return float(weights @ speed), float(weights @ pressure / weights.sum())

    def _weights(self, places: FloatArray) -> tuple[Any, FloatArray]:
        """Shape functions (p, 10) at places in the element that holds each; whether one does."""
        near = self.tree.query(places, k=min(_NEAR, len(self.cells)))[1]
        best = np.full(len(places), np.inf)
        weight, self.found = np.zeros((len(places), 10)), self.cells[near[:, 0]].copy()
        for column in near.T:
            open_ = best > _INSIDE
            if not open_.any():
                break
            cells = self.cells[column[open_]]
            at = _inverse(self.points[cells], places[open_])
            outside = np.maximum(-at.min(axis=1), at.sum(axis=1) - 1.0)
            better = outside < best[open_]
            where = np.flatnonzero(open_)[better]
            best[where] = outside[better]
            weight[where], self.found[where] = quadratic_shapes(at[better])[0], cells[better]
        return best < 0.02, weight


def _disc(centre: FloatArray, along: FloatArray, radius: float) -> tuple[FloatArray, FloatArray]:
    side = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    side /= np.linalg.norm(side)
    other = np.cross(along, side)
    node, share = np.polynomial.legendre.leggauss(12)
    rho, turns = 0.5 * radius * (node + 1.0), 2.0 * np.pi * (np.arange(24) + 0.5) / 24
    r, a = (x.ravel() for x in np.meshgrid(rho, turns, indexing="ij"))
    weight = np.repeat(0.5 * radius * share * rho, 24) * 2.0 * np.pi / 24
    return centre + np.outer(r * np.cos(a), side) + np.outer(r * np.sin(a), other), weight


def quadratic_shapes(at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """VTK's quadratic tetrahedron: values (p, 10), derivatives (p, 10, 3)."""
    one = np.column_stack([1.0 - at.sum(axis=1), at])
    slope = np.vstack([-np.ones(3), np.eye(3)])
    pairs = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
    value = [one[:, i] * (2.0 * one[:, i] - 1.0) for i in range(4)]
    value += [4.0 * one[:, i] * one[:, j] for i, j in pairs]
    first = [(4.0 * one[:, i] - 1.0)[:, None] * slope[i] for i in range(4)]
    first += [4.0 * (one[:, i, None] * slope[j] + one[:, j, None] * slope[i]) for i, j in pairs]
    return np.stack(value, axis=1), np.stack(first, axis=1)


def _inverse(nodes: FloatArray, places: FloatArray) -> FloatArray:
    """Reference coordinates of places in elements (p, 10, 3), by Newton's steps."""
    at = np.full((len(places), 3), 0.25)
    for _ in range(_STEPS):
        value, slope = quadratic_shapes(at)
        off = np.einsum("pn,pnk->pk", value, nodes) - places
        jacobian = np.einsum("pnd,pnk->pkd", slope, nodes)
        safe = np.abs(np.linalg.det(jacobian)) > 1e-14
        jacobian[~safe] = np.eye(3)
        at = np.clip(at - np.linalg.solve(jacobian, off[..., None])[..., 0], -2.0, 3.0)
    return at
