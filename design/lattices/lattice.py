"""Fill a tissue with a regular lattice of channels, for comparison with grown trees."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.errors import NetworkError, TissueError
from design.lattices.cells import narrowest, tile, unit_cell
from design.lattices.options import LatticeOptions
from design.lattices.orient import directed
from design.lattices.port import find_port
from design.network import VesselKind, VesselNetwork
from design.tissue import Tissue
from kernels.arrays import FloatArray, IntArray

_LAYER = 0.75
"""Depth of the manifolds' layer over the cell's edge: planes of nodes lie up to this far apart
from a cell's first, and a whole cell from the next cell's."""

_CELLS_AT_MOST = 2_000_000


def build_lattice(tissue: Tissue, options: LatticeOptions) -> VesselNetwork:
    """Fill a tissue with a lattice that has one inlet and one outlet.

    The lattice lies centred in the tissue's bounds. Of the channels that fit (lumen and
    clearance), the largest part is kept in which none is a dead end: every channel lies on a way
    from any port to any other. Its first and last layers along the axis are widened to manifolds,
    and a port leads from each straight out of the tissue. Vessels point with the flow, or at
    least from inlet to outlet without a cycle (see `design.lattices.orient.directed`).

    Returns
    -------
    VesselNetwork
        Vessels of kind `CHANNEL`; the inlet's port is the last but one, the outlet's the last.

    Raises
    ------
    NetworkError
        When channels would meet that don't join.
    TissueError
        When no part of the lattice fits, or no port reaches it.
    """
    cell = unit_cell(options.kind)
    gap = narrowest(cell) * options.cell_mm - 2.0 * options.manifold_mm
    if gap < options.clearance_mm or gap <= 0.0:
        raise NetworkError(
            f"{options.kind} of cell_mm {options.cell_mm:g}: the manifolds (channels beside the "
            f"ports, {2.0 * options.manifold_mm:g} mm wide, by default 1.5 times the others) leave "
            f"{gap:.3g} mm between them, clearance_mm {options.clearance_mm:g} is needed; enlarge "
            "the cell, or narrow the channels or the manifolds"
        )
    nodes, bonds = _fitting(tissue, options)
    axis = "xyz".index(options.axis)
    radius = _widened(tissue, options, nodes, bonds, axis)
    low, entry = find_port(
        tissue,
        nodes,
        bonds,
        radius,
        options.manifold_mm,
        options.clearance_mm,
        axis,
        -1,
        _layer(options, nodes, axis, -1),
    )
    high, leave = find_port(
        tissue,
        nodes,
        bonds,
        radius,
        options.manifold_mm,
        options.clearance_mm,
        axis,
        1,
        _layer(options, nodes, axis, 1),
    )
    length = np.linalg.norm(nodes[bonds[:, 1]] - nodes[bonds[:, 0]], axis=1)
    bonds = directed(bonds, radius**4 / length, len(nodes), low, high)
    count = len(nodes)
    ends = np.concatenate([bonds, [[count, low], [high, count + 1]]])
    return VesselNetwork.from_segments(
        np.concatenate([nodes, [entry, leave]]),
        ends,
        np.append(radius, [options.manifold_mm] * 2),
        np.full(len(ends), int(VesselKind.CHANNEL)),
        np.zeros(len(ends), dtype=np.int64),
    )


def _fitting(tissue: Tissue, options: LatticeOptions) -> tuple[FloatArray, IntArray]:
    """Nodes (n, 3), mm, and bonds (m, 2) of the largest part that fits without dead ends."""
    import networkx  # heavy, and every design loads this module

    cell = unit_cell(options.kind)
    low, high = tissue.bounds
    size = cell.size * options.cell_mm
    counts = np.maximum(1, np.ceil((high - low) / size)).astype(int) + 1
    if counts.prod() > _CELLS_AT_MOST:
        raise NetworkError(
            f"{options.kind} of cell_mm {options.cell_mm:g} would take {counts.prod():,} cells, "
            f"above {_CELLS_AT_MOST:,}; enlarge the cell"
        )
    nodes, bonds = tile(cell, (int(counts[0]), int(counts[1]), int(counts[2])))
    nodes = nodes * options.cell_mm
    nodes += 0.5 * (low + high) - 0.5 * (nodes.min(axis=0) + nodes.max(axis=0))
    reach = np.full(len(bonds), options.radius_mm)
    inside = tissue.grid.capsule_inside(
        nodes[bonds[:, 0]], nodes[bonds[:, 1]], reach, options.clearance_mm
    )
    parts: Any = networkx.biconnected_component_edges(networkx.Graph(bonds[inside].tolist()))
    largest = np.array(max(parts, key=len, default=[]), dtype=np.int64).reshape(-1, 2)
    if len(largest) < 3:
        raise TissueError(
            f"{options.kind} of cell_mm {options.cell_mm:g} and radius_mm {options.radius_mm:g}: "
            "no mesh of it fits into the tissue; lower cell_mm or radius_mm"
        )
    # The order in which a search meets edges is no order to keep.
    largest = np.unique(np.sort(largest, axis=1), axis=0)
    kept, number = np.unique(largest, return_inverse=True)
    return nodes[kept], number.reshape(-1, 2)


def _layer(options: LatticeOptions, nodes: FloatArray, axis: int, side: int) -> Any:
    """Which nodes (n,) belong to the first (side -1) or last (+1) layer."""
    depth = _LAYER * unit_cell(options.kind).size[axis] * options.cell_mm * (1.0 + 1e-6)
    along = -side * nodes[:, axis]
    return along <= along.min() + depth


def _widened(
    tissue: Tissue, options: LatticeOptions, nodes: FloatArray, bonds: IntArray, axis: int
) -> FloatArray:
    """Radius of each bond, (m,), mm: in a manifold's layer the manifold's, where it fits."""
    wide = np.full(len(bonds), options.manifold_mm)
    fits = tissue.grid.capsule_inside(
        nodes[bonds[:, 0]], nodes[bonds[:, 1]], wide, options.clearance_mm
    )
    ends = np.zeros(len(bonds), dtype=bool)
    for side in (-1, 1):
        ends |= _layer(options, nodes, axis, side)[bonds].all(axis=1)
    return np.where(ends & fits, options.manifold_mm, options.radius_mm)
