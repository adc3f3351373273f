"""Find places where a network's own filaments overlap away from its nodes.

The measure is that of the check before a print (docs/embedded.md), so that plan and check spare
the same ink: spots every half radius of a vessel (0.05 to 0.1 mm), pairs of them that reach a
quarter of the thinner radius into each other, further from common nodes than a joint reaches.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from design.network import VesselNetwork
from design.toolpath.embedded.needle import ROUNDING_MM, Needle, joint_reach
from kernels import jit
from kernels.arrays import FloatArray, IntArray


class _Touching(NamedTuple):
    """When filaments count as one body, and where that is looked for."""

    # Nearer than this part of the way along vessels: what lies ahead on a thick vessel is near,
    # too, but no collision.
    beside: float = 0.7
    # Reach into each other, in radii of the thinner one; where they only brush the order matters.
    deep: float = 0.25
    finest_mm: float = 0.05  # between spots: half the vessel's least radius, but no less
    coarsest_mm: float = 0.1  # and no more
    # Places are told by the middles of cells of that size along both vessels, which begin at a part
    # of a cell at which no spot of a straight vessel of round length lies.
    cell_mm: float = 0.05
    cell_from: float = 0.3183
    cells: int = 2_000_000  # cubes in which spots are looked up, at most


TOUCHING: Final = _Touching()


class Touches(NamedTuple):
    """Pairs of places at which filaments overlap."""

    vessel: IntArray  # (k, 2)
    arc: FloatArray  # (k, 2), way along either vessel, mm
    overlap: FloatArray  # (k,), by which the two reach into each other, mm
    gap: FloatArray  # (k,), between the axes, mm


class _Spots(NamedTuple):
    """Places along all vessels: (n, 3) mm, and of each its vessel, way along it, and radius."""

    place: FloatArray
    vessel: IntArray
    arc: FloatArray
    radius: FloatArray


class _Cells(NamedTuple):
    """Spots by cubes, those of cube c in ``member[begin[c]:begin[c + 1]]``."""

    origin: FloatArray
    pitch: float
    shape: IntArray
    begin: IntArray
    member: IntArray


def touches(network: VesselNetwork, needle: Needle) -> Touches:
    """Where filaments overlap further from their common nodes than a joint reaches.

    What overlaps is one body when both are written, whichever comes first; the shaft passes through
    it there as through a joint. Whether the design means it is the designer's to say.
    """
    arc, length = arcs_of(network)
    spots = _spots(network, arc)
    pair, deep = _overlapping(spots, _cells(spots), network.vessel_nodes, length, needle)
    gap = spots.radius[pair].sum(axis=1) - deep
    return _in_cells(Touches(spots.vessel[pair], spots.arc[pair], deep, gap))


def arcs_of(network: VesselNetwork) -> tuple[FloatArray, FloatArray]:
    """Way along its vessel to each point, (p,), and length of each vessel, (v,), mm."""
    step = np.linalg.norm(np.diff(network.points, axis=0, prepend=network.points[:1]), axis=1)
    whole = np.cumsum(step)
    arc = whole - np.repeat(whole[network.offset[:-1]], np.diff(network.offset))
    return arc, arc[network.offset[1:] - 1]


def _spots(network: VesselNetwork, arc: FloatArray) -> _Spots:
    least = np.minimum.reduceat(network.radius, network.offset[:-1]) / 2
    pitch = np.repeat(least.clip(TOUCHING.finest_mm, TOUCHING.coarsest_mm), np.diff(network.offset))
    length = np.append(np.diff(arc), 0.0)
    last = network.offset[1:] - 1
    length[last] = 0.0
    parts = np.maximum(np.ceil(length / pitch), 1).astype(np.int64)
    row = np.repeat(np.arange(len(parts)), parts)
    share = (np.arange(len(row)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[row]
    after = np.minimum(row + 1, len(parts) - 1)
    values = np.column_stack([network.points, arc, network.radius])
    mixed = values[row] + share[:, None] * (values[after] - values[row])
    vessel = np.repeat(np.arange(len(last)), np.diff(network.offset))[row]
    return _Spots(
        np.ascontiguousarray(mixed[:, :3]), vessel, mixed[:, 3].copy(), mixed[:, 4].copy()
    )


def _cells(spots: _Spots) -> _Cells:
    low, size = spots.place.min(axis=0), np.ptp(spots.place, axis=0)
    pitch = max(2 * float(spots.radius.max()), float(np.cbrt(size.prod() / TOUCHING.cells)), 1e-3)
    pitch = max(pitch, float(size.max()) / 1000)
    at = np.floor((spots.place - low) / pitch).astype(np.int64)
    shape = at.max(axis=0) + 1
    cell = (at[:, 0] * shape[1] + at[:, 1]) * shape[2] + at[:, 2]
    begin = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=int(shape.prod())))])
    return _Cells(low, pitch, shape, begin, np.argsort(cell, kind="stable"))


def _in_cells(all_touches: Touches) -> Touches:
    """The nearest of each cell along both vessels, at the cell's middle."""
    cell = np.floor(all_touches.arc / TOUCHING.cell_mm + TOUCHING.cell_from)
    order = np.argsort(all_touches.gap, kind="stable")
    key = np.column_stack([all_touches.vessel, cell])[order]
    rows = np.sort(order[np.unique(key, axis=0, return_index=True)[1]])
    middle = (cell[rows] + 0.5 - TOUCHING.cell_from) * TOUCHING.cell_mm
    return Touches(
        all_touches.vessel[rows], middle, all_touches.overlap[rows], all_touches.gap[rows]
    )


@jit
def _overlapping(
    spots: _Spots, cells: _Cells, ends: IntArray, length: FloatArray, needle: Needle
) -> tuple[IntArray, FloatArray]:
    """Pairs of spots (k, 2) that overlap, the lower vessel first, and how deep."""
    one, other, deep = [0][:0], [0][:0], [0.0][:0]
    for i in range(len(spots.vessel)):
        at = ((spots.place[i] - cells.origin) / cells.pitch).astype(np.int64)
        for x in range(max(0, at[0] - 1), min(cells.shape[0], at[0] + 2)):
            for y in range(max(0, at[1] - 1), min(cells.shape[1], at[1] + 2)):
                row = (x * cells.shape[1] + y) * cells.shape[2]
                low = cells.begin[row + max(0, at[2] - 1)]
                high = cells.begin[row + min(cells.shape[2], at[2] + 2)]
                for m in range(low, high):
                    j = cells.member[m]
                    if j <= i or _gap2(i, j, spots) > (spots.radius[i] + spots.radius[j]) ** 2:
                        continue
                    reach = _reaches(i, j, spots, ends, length, needle)
                    if reach > 0.0:
                        one.append(i)
                        other.append(j)
                        deep.append(reach)
    pair = np.empty((len(one), 2), np.int64)
    for k in range(len(one)):
        pair[k, 0], pair[k, 1] = one[k], other[k]
    return pair, np.array(deep, np.float64)


@jit
def _gap2(i: int, j: int, spots: _Spots) -> float:
    a, b = spots.place[i], spots.place[j]
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2


@jit
def _reaches(
    i: int, j: int, spots: _Spots, ends: IntArray, length: FloatArray, needle: Needle
) -> float:
    """How far two spots reach into each other, mm; 0 where it is none, or a joint's."""
    thin, thick = min(spots.radius[i], spots.radius[j]), max(spots.radius[i], spots.radius[j])
    far, gap = thin + thick - TOUCHING.deep * thin, _gap2(i, j, spots)
    if gap > far * far:
        return 0.0
    gap = np.sqrt(gap)
    joint = joint_reach(needle, thick) + ROUNDING_MM  # not earlier: a touch spares ink
    u, v, way = spots.vessel[i], spots.vessel[j], np.inf
    if u == v:
        way = abs(spots.arc[i] - spots.arc[j])
        if way <= joint:
            return 0.0
    for a in range(2):
        for b in range(2):
            if ends[u, a] != ends[v, b] or (u == v and a == b):
                continue
            here, there = abs(spots.arc[i] - a * length[u]), abs(spots.arc[j] - b * length[v])
            if max(here, there) <= joint:
                return 0.0
            way = min(way, here + there)
    return thin + thick - gap if gap < TOUCHING.beside * way else 0.0
