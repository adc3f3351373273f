"""Unit cells of channel lattices, and their repetition into nodes and straight bonds."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from design.geometry import segment_segment
from design.lattices.options import LatticeKind
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class UnitCell:
    """A periodic graph of straight bonds, in units of the cell's edge along x.

    Attributes
    ----------
    size : (3,) float64
        Edges of the cell.
    nodes : (k, 3) float64
    bonds : (b, 2) int64
        Nodes that a bond joins.
    shift : (b, 3) int64
        Cells from the first node's to the second's.
    """

    size: FloatArray
    nodes: FloatArray
    bonds: IntArray
    shift: IntArray


_ROOT3: Final = float(np.sqrt(3.0))
_CUBE: Final = (1.0, 1.0, 1.0)
_EIGHTHS: Final = [(1, 1, 1), (3, 7, 5), (7, 5, 3), (5, 3, 7)]
_FACES: Final = [(0, 0, 0), (0, 2, 2), (2, 0, 2), (2, 2, 0)]


def unit_cell(kind: LatticeKind) -> UnitCell:
    """The cell of a lattice.

    - ``grid``: cubic grid, the skeleton of Schwarz' P surface (net pcu).
    - ``honeycomb``: hexagons one cell across in each layer, joined layer to layer.
    - ``gyroid``: the skeleton of one of the gyroid's two labyrinths (net srs, three bonds a node).
    - ``diamond``: the skeleton of Schwarz' D surface (net dia, four bonds a node).

    The nets' coordinates are those of the Reticular Chemistry Structure Resource
    (O'Keeffe et al. 2008, doi 10.1021/ar800124u).
    """
    if kind == "grid":
        return _joined(_CUBE, [(0.0, 0.0, 0.0)], (1.0,))
    if kind == "honeycomb":
        side = 1.0 / _ROOT3
        plane = [(0.0, 0.0), (0.5, 0.5 * side), (0.5, 1.5 * side), (0.0, 2.0 * side)]
        return _joined((1.0, _ROOT3, 1.0), [(x, y, 0.0) for x, y in plane], (side, 1.0))
    if kind == "gyroid":
        corner = np.array(_EIGHTHS) / 8.0
        return _joined(_CUBE, np.concatenate([corner, (corner + 0.5) % 1.0]), (np.sqrt(0.125),))
    face = np.array(_FACES) / 4.0
    return _joined(_CUBE, np.concatenate([face, face + 0.25]), (_ROOT3 / 4.0,))


def _joined(size: object, nodes: object, lengths: tuple[float, ...]) -> UnitCell:
    """Join all nodes of the periodic pattern that are one of ``lengths`` apart.

    In the honeycomb 1 is also the distance across a hexagon: bonds longer than the first length
    run along z alone.
    """
    period, place = np.array(size, dtype=np.float64), np.array(nodes, dtype=np.float64)
    bonds, shifts = [], []
    for shift in product((-1, 0, 1), repeat=3):
        for i, j in product(range(len(place)), repeat=2):
            step = place[j] + np.array(shift) * period - place[i]
            # Each bond once: of the two ways along it, the one that goes up.
            if not tuple(np.round(step, 9)) > (0.0, 0.0, 0.0):
                continue
            along = float(np.linalg.norm(step))
            upright = abs(along - abs(step[2])) < 1e-9
            if any(abs(along - a) < 1e-9 and (a == lengths[0] or upright) for a in lengths):
                bonds.append((i, j))
                shifts.append(shift)
    return UnitCell(period, place, np.array(bonds), np.array(shifts))


def tile(cell: UnitCell, counts: tuple[int, int, int]) -> tuple[FloatArray, IntArray]:
    """Nodes (n, 3) and bonds (m, 2) of ``counts`` cells from the origin, open at the sides."""
    index = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, 3)
    nodes = (index[:, None] * cell.size + cell.nodes).reshape(-1, 3)
    parts = []
    for (i, j), shift in zip(cell.bonds, cell.shift, strict=True):
        to = index + shift
        there = ((to >= 0) & (to < counts)).all(axis=1)
        number = np.ravel_multi_index(tuple(to[there].T), counts)
        parts.append(
            np.column_stack(
                [np.flatnonzero(there) * len(cell.nodes) + i, number * len(cell.nodes) + j]
            )
        )
    return nodes, np.concatenate(parts)


def narrowest(cell: UnitCell) -> float:
    """Least distance of the axes of two bonds that share no node, in units of the cell."""
    nodes, bonds = tile(cell, (3, 3, 3))
    length = np.linalg.norm(nodes[bonds[:, 1]] - nodes[bonds[:, 0]], axis=1).max()
    middle = nodes[bonds].mean(axis=1)
    centre = int(np.argmin(np.linalg.norm(middle - nodes.mean(axis=0), axis=1)))
    near = np.linalg.norm(middle - middle[centre], axis=1)
    least = np.inf
    inner = np.flatnonzero(near < cell.size.max())
    for one in inner:
        for two in np.flatnonzero(near < cell.size.max() + 2.0 * length):
            if not set(bonds[one]) & set(bonds[two]):
                ends = nodes[np.concatenate([bonds[one], bonds[two]])].ravel()
                least = min(least, segment_segment(*ends)[0])
    return float(least)
