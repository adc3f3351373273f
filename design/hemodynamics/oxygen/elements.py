"""Cut vessels into short elements coupled to tissue grid cells; find each cell's lumen fraction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics.oxygen.tissue_grid import TissueGrid
from design.network import VesselNetwork
from kernels import jit
from kernels.arrays import FloatArray, IntArray

_RINGS = 2
"""Rings of source points in an element of one cell's length."""

_THIN = 0.25
"""Lumens of a smaller radius, in cells, have one point instead of a ring."""


@dataclass(frozen=True)
class Elements:
    """Pieces of vessels, about a cell long, vessel by vessel.

    Attributes
    ----------
    vessel : (n,) int64
    offset : (v + 1,) int64
        Elements of vessel ``i`` are ``offset[i]:offset[i + 1]``, from its first node on.
    length, radius : (n,) float64, mm
    start : (n + 1,) int64
        Cells of element ``e`` are ``start[e]:start[e + 1]`` of the arrays below.
    cell : (k,) int64
        Flat index into the grid.
    weight : (k,) float64
        Sum to 1 for an element in the tissue; one more than half outside has none.
    """

    vessel: IntArray
    offset: IntArray
    length: FloatArray
    radius: FloatArray
    start: IntArray
    cell: IntArray
    weight: FloatArray


def cut_vessels(network: VesselNetwork, grid: TissueGrid) -> Elements:
    """Cut each vessel into equal parts no longer than a cell, and find the cells of each."""
    lengths, h = network.lengths(), grid.spacing_mm
    count = np.maximum(np.ceil(lengths / h - 1e-9).astype(np.int64), 1)
    vessel = np.repeat(np.arange(network.vessel_count), count)
    offset = np.concatenate([[0], np.cumsum(count)])
    number = np.arange(len(vessel)) - offset[vessel]
    part = (number[:, None] + (np.arange(_RINGS) + 0.5) / _RINGS) / count[vessel][:, None]
    at, axis, radius = _along(network, np.repeat(vessel, _RINGS), part.ravel())
    mean = radius.reshape(-1, _RINGS).mean(axis=1)
    points = np.where(
        mean < _THIN * h, 1, np.maximum(np.ceil(2.0 * np.pi * mean / (0.75 * h)), 4)
    ).astype(np.int64)
    start = 27 * _RINGS * np.concatenate([[0], np.cumsum(points)])
    cell = np.zeros(start[-1], dtype=np.int64)
    weight = np.zeros(start[-1])
    _spread(at, axis, radius, points, grid.origin_mm, h, grid.inside, start, cell, weight)
    return Elements(vessel, offset, lengths[vessel] / count[vessel], mean, start, cell, weight)


def _along(
    network: VesselNetwork, vessel: IntArray, part: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place (n, 3), unit direction (n, 3) and radius (n,) at a share of each vessel's length."""
    step = np.linalg.norm(np.diff(network.points, axis=0), axis=1)
    step[network.offset[1:-1] - 1] = 0.0
    arc = np.concatenate([[0.0], np.cumsum(step)])
    first, last = network.offset[vessel], network.offset[vessel + 1] - 1
    asked = arc[first] + part * (arc[last] - arc[first])
    k = np.clip(np.searchsorted(arc, asked, side="right") - 1, first, last - 1)
    wide = np.maximum(arc[k + 1] - arc[k], 1e-300)
    share = np.clip((asked - arc[k]) / wide, 0.0, 1.0)
    a, b = network.points[k], network.points[k + 1]
    radius = network.radius[k] + share * (network.radius[k + 1] - network.radius[k])
    return a + share[:, None] * (b - a), (b - a) / wide[:, None], radius


@jit
def _spread(
    at: FloatArray,
    axis: FloatArray,
    radius: FloatArray,
    points: IntArray,
    origin: FloatArray,
    h: float,
    inside: NDArray[np.bool_],
    start: IntArray,
    cell: IntArray,
    weight: FloatArray,
) -> None:
    """Lay each element's ring points on 27 cells each by quadratic B-splines.

    What falls on cells outside the tissue is shared out among those inside: nothing passes the
    surface. In one kernel because the weights' count is only known here.
    """
    nx, ny, nz = inside.shape
    low, across, other, where = np.empty(3, np.int64), np.empty(3), np.empty(3), np.empty(3)
    spline = np.empty((3, 3))
    for e in range(len(points)):
        k, total = start[e], 0.0
        for ring in range(_RINGS):
            i = e * _RINGS + ring
            least = np.argmin(np.abs(axis[i]))
            across[:] = -axis[i, least] * axis[i]
            across[least] += 1.0
            across /= np.sqrt((across**2).sum()) + 1e-300
            other[0] = axis[i, 1] * across[2] - axis[i, 2] * across[1]
            other[1] = axis[i, 2] * across[0] - axis[i, 0] * across[2]
            other[2] = axis[i, 0] * across[1] - axis[i, 1] * across[0]
            for p in range(points[e]):
                # The two rings are turned against each other by half a step.
                angle = 2.0 * np.pi * (p + 0.5 * ring) / points[e]
                out = radius[i] if points[e] > 1 else 0.0
                where[:] = at[i] + out * (np.cos(angle) * across + np.sin(angle) * other)
                for d in range(3):
                    x = (where[d] - origin[d]) / h
                    middle = np.floor(x + 0.5)
                    low[d] = np.int64(middle) - 1
                    f = x - middle
                    spline[d, 0] = 0.5 * (0.5 - f) ** 2
                    spline[d, 1] = 0.75 - f * f
                    spline[d, 2] = 0.5 * (0.5 + f) ** 2
                for a in range(3):
                    for b in range(3):
                        for c in range(3):
                            x0, y0, z0 = low[0] + a, low[1] + b, low[2] + c
                            within = 0 <= x0 < nx and 0 <= y0 < ny and 0 <= z0 < nz
                            if within and inside[x0, y0, z0]:
                                cell[k] = (x0 * ny + y0) * nz + z0
                                weight[k] = spline[0, a] * spline[1, b] * spline[2, c]
                                total += weight[k]
                            k += 1
        share = total / (_RINGS * points[e])
        scale = 1.0 / total if share > 0.5 else 0.0
        for k in range(start[e], start[e + 1]):
            weight[k] *= scale


def lumen_share(network: VesselNetwork, grid: TissueGrid) -> FloatArray:
    """Share of each cell that is lumen, (nx, ny, nz), 0 to 1; no uptake there."""
    h = grid.spacing_mm
    start, end, r0, r1, _ = network.pieces()
    filled = np.zeros(grid.inside.shape)
    _fill(start, end, r0, r1, grid.origin_mm, h, filled)
    return np.minimum(filled, 1.0, out=filled)


@jit
def _fill(
    start: FloatArray,
    end: FloatArray,
    r0: FloatArray,
    r1: FloatArray,
    origin: FloatArray,
    h: float,
    filled: FloatArray,
) -> None:
    """Add the volume of each piece, in points a third of a cell apart, to the cells they lie in."""
    nx, ny, nz = filled.shape
    across, other = np.empty(3), np.empty(3)
    for i in range(len(start)):
        axis = end[i] - start[i]
        length = np.sqrt((axis**2).sum())
        if length == 0.0:
            continue
        axis = axis / length
        least = np.argmin(np.abs(axis))
        across[:] = -axis[least] * axis
        across[least] += 1.0
        across /= np.sqrt((across**2).sum())
        other[0] = axis[1] * across[2] - axis[2] * across[1]
        other[1] = axis[2] * across[0] - axis[0] * across[2]
        other[2] = axis[0] * across[1] - axis[1] * across[0]
        steps = int(np.ceil(3.0 * length / h))
        for s in range(steps):
            t = (s + 0.5) / steps
            radius = r0[i] + t * (r1[i] - r0[i])
            rings = max(1, int(np.ceil(3.0 * radius / h)))
            for ring in range(rings):
                out = radius * (ring + 0.5) / rings
                if rings == 1:
                    out = 0.0 if radius < 0.25 * h else 0.5 * radius
                points = max(4, int(np.ceil(6.0 * np.pi * out / h)))
                area = np.pi * radius**2 * (2.0 * ring + 1.0) / rings**2
                for p in range(points):
                    angle = 2.0 * np.pi * (p + 0.5 * (s % 2)) / points
                    ca, sa = np.cos(angle), np.sin(angle)
                    x = start[i] + t * length * axis + out * (ca * across + sa * other)
                    a = int(np.floor((x[0] - origin[0]) / h + 0.5))
                    b = int(np.floor((x[1] - origin[1]) / h + 0.5))
                    c = int(np.floor((x[2] - origin[2]) / h + 0.5))
                    if 0 <= a < nx and 0 <= b < ny and 0 <= c < nz:
                        filled[a, b, c] += area * length / (steps * points * h**3)
