"""Fill a tissue with a regular lattice of channels that has one inlet and one outlet."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from design.errors import NetworkError, TissueError
from design.geometry import segment_segment
from design.lattices.options import LatticeKind, LatticeOptions
from design.network import VesselKind, VesselNetwork
from design.tissue import Tissue
from kernels.arrays import FloatArray, IntArray

LAYER_DEPTH = 0.75
"""Of the manifolds' layer over the cell's edge: planes of nodes lie up to this far apart from a
cell's first, and a whole cell from the next cell's."""
MAX_CELLS = 2_000_000
"""Of a lattice: their nodes and bonds take 1 GB."""


def build_lattice(tissue: Tissue, options: LatticeOptions) -> VesselNetwork:
    """Fill a tissue with a lattice that has one inlet and one outlet.

    The lattice lies centred in the tissue's bounds. Of the channels that fit (lumen and
    clearance), the largest part is kept in which none is a dead end: every channel lies on a way
    from any port to any other. Its first and last layers along the axis are widened to manifolds,
    and a port leads from each straight out of the tissue. Vessels point with the flow, or at
    least from inlet to outlet without a cycle (see `design.lattices.lattice.directed`).

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
    radius = _widened(tissue, options, nodes, bonds)
    low, entry = find_port(tissue, options, nodes, bonds, radius, -1)
    high, leave = find_port(tissue, options, nodes, bonds, radius, 1)
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
    if counts.prod() > MAX_CELLS:
        raise NetworkError(
            f"{options.kind} of cell_mm {options.cell_mm:g} would take {counts.prod():,} cells, "
            f"above {MAX_CELLS:,}; enlarge the cell"
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


def _axis(options: LatticeOptions) -> int:
    return "xyz".index(options.axis)


def _layer(options: LatticeOptions, nodes: FloatArray, side: int) -> NDArray[np.bool_]:
    """Which nodes (n,) belong to the first (side -1) or last (+1) layer."""
    axis = _axis(options)
    depth = LAYER_DEPTH * unit_cell(options.kind).size[axis] * options.cell_mm * (1.0 + 1e-6)
    along = -side * nodes[:, axis]
    return np.asarray(along <= along.min() + depth)


def _widened(
    tissue: Tissue, options: LatticeOptions, nodes: FloatArray, bonds: IntArray
) -> FloatArray:
    """Radius of each bond, (m,), mm: in a manifold's layer the manifold's, where it fits."""
    wide = np.full(len(bonds), options.manifold_mm)
    fits = tissue.grid.capsule_inside(
        nodes[bonds[:, 0]], nodes[bonds[:, 1]], wide, options.clearance_mm
    )
    ends = np.zeros(len(bonds), dtype=bool)
    for side in (-1, 1):
        ends |= _layer(options, nodes, side)[bonds].all(axis=1)
    return np.where(ends & fits, options.manifold_mm, options.radius_mm)


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


def directed(
    edges: IntArray, conductance: FloatArray, count: int, source: int, sink: int
) -> IntArray:
    """``edges`` turned so that all lead from ``source`` to ``sink`` without a cycle.

    They follow the flow from source to sink. Where it stands still to rounding, so that another
    node would seem an inlet or outlet, all follow `st_order` instead.

    Parameters
    ----------
    edges : (m, 2) int64
        Of a graph that is biconnected once source and sink are joined.
    conductance : (m,) float64
    count, source, sink : int
        Nodes, and the two ends.
    """
    turned = _turned(edges, -_potential(edges, conductance, count, source, sink))
    if _leads(turned, count, source, sink):
        return turned
    return _turned(edges, st_order(edges, count, source, sink))


def _potential(
    edges: IntArray, conductance: FloatArray, count: int, source: int, sink: int
) -> FloatArray:
    """Potential of each node, (n,): 1 at the source, 0 at the sink, no flow lost between."""
    a, b = edges.T
    weights = np.concatenate([conductance, conductance, -conductance, -conductance])
    rows, columns = np.concatenate([a, b, a, b]), np.concatenate([a, b, b, a])
    matrix = coo_array((weights, (rows, columns)), shape=(count, count)).tocsr()
    free = np.setdiff1d(np.arange(count), [source, sink])
    potential = np.zeros(count)
    potential[source] = 1.0
    if len(free):
        load = -(matrix @ potential)[free]
        potential[free] = spsolve(matrix[free][:, free].tocsc(), load)
    return potential


def _turned(edges: IntArray, place: IntArray | FloatArray) -> IntArray:
    """Edges from the lower to the higher place."""
    up = place[edges[:, 0]] < place[edges[:, 1]]
    turned: IntArray = np.where(up[:, None], edges, edges[:, ::-1])
    return turned


def _leads(edges: IntArray, count: int, source: int, sink: int) -> bool:
    """Whether the source alone isn't entered, and the sink alone isn't left."""
    left, entered = (np.bincount(end, minlength=count) > 0 for end in edges.T)
    return bool(
        np.array_equal(np.flatnonzero(~entered), [source])
        and np.array_equal(np.flatnonzero(~left), [sink])
    )


def st_order(edges: IntArray, count: int, source: int, sink: int) -> IntArray:
    """Place of each node in an order from ``source`` to ``sink``.

    Only the source has no earlier neighbour, and only the sink no later one.
    Tarjan's method (1986, doi 10.3233/FI-1986-9105): each node of a depth-first search is put
    just before or just after its parent, by the side on which its lowest ancestor in reach lies.

    Parameters
    ----------
    edges : (m, 2) int64
        Of a graph that is biconnected once source and sink are joined.
    count : int
        Nodes.
    source, sink : int
    """
    neighbours = _neighbours(edges, count)
    order, parent, low = _search(neighbours, source, sink)
    after = np.full(count, -1)
    before = np.full(count, -1)
    after[source], before[sink] = sink, source
    low_side = np.zeros(count, dtype=bool)
    # The source's side is below, until a node is put there.
    low_side[source] = True
    for node in order[2:]:
        anchor = parent[node]
        if low_side[low[node]]:
            left, right = before[anchor], anchor
            low_side[anchor] = False
        else:
            left, right = anchor, after[anchor]
            low_side[anchor] = True
        before[node], after[node] = left, right
        if left >= 0:
            after[left] = node
        if right >= 0:
            before[right] = node
    place = np.empty(count, dtype=np.int64)
    node = source
    for k in range(count):
        place[node] = k
        node = int(after[node])
    return place


def _neighbours(edges: IntArray, count: int) -> list[list[int]]:
    lists: list[list[int]] = [[] for _ in range(count)]
    for a, b in edges.tolist():
        lists[a].append(b)
        lists[b].append(a)
    return lists


def _search(
    neighbours: list[list[int]], source: int, sink: int
) -> tuple[list[int], list[int], list[int]]:
    """Depth-first order beginning source, sink; parents; lowest ancestor in reach of each."""
    count = len(neighbours)
    number = [-1] * count
    parent = [-1] * count
    low = list(range(count))
    order = [source, sink]
    number[source], number[sink] = 0, 1
    parent[sink] = source
    low[sink] = source
    stack = [(sink, iter(neighbours[sink]))]
    while stack:
        node, rest = stack[-1]
        for to in rest:
            if number[to] < 0:
                number[to] = len(order)
                order.append(to)
                parent[to] = node
                stack.append((to, iter(neighbours[to])))
                break
            if to != parent[node] and number[to] < number[low[node]]:
                low[node] = to
        else:
            stack.pop()
            up = parent[node]
            if number[low[node]] < number[low[up]]:
                low[up] = low[node]
    return order, parent, low


def find_port(
    tissue: Tissue,
    options: LatticeOptions,
    nodes: FloatArray,
    bonds: IntArray,
    radius: FloatArray,
    side: int,
) -> tuple[int, FloatArray]:
    """Return the node of a layer nearest its middle from which a port leads out, and its end.

    Parameters
    ----------
    nodes : (n, 3) float64, mm
    bonds : (m, 2) int64
    radius : (m,) float64, mm
        Of each bond.
    side : int
        -1 for the lower end of the lattice's axis, 1 for the upper.

    Raises
    ------
    TissueError
        When none does without meeting other channels or more tissue.
    """
    axis = _axis(options)
    candidates = np.flatnonzero(_layer(options, nodes, side))
    across = np.delete(nodes[candidates], axis, axis=1)
    away = np.linalg.norm(across - across.mean(axis=0), axis=1)
    # Of those above one another the outermost; rounded, since their distances differ by rounding.
    order = np.lexsort((-side * nodes[candidates, axis], np.round(away, 9)))
    needed = radius + options.manifold_mm + options.clearance_mm
    for node in candidates[order].tolist():
        end = _way_out(tissue, nodes[node], axis, side)
        if end is not None and _is_free(node, end, nodes, bonds, needed):
            return node, end
    raise TissueError(
        f"none of the {len(candidates)} nodes at the {'lower' if side < 0 else 'upper'} end along "
        f"{options.axis} has a straight way out for a port {2.0 * options.manifold_mm:g} mm wide; "
        "choose another axis, or narrower manifolds"
    )


def _way_out(tissue: Tissue, start: FloatArray, axis: int, side: int) -> FloatArray | None:
    """Where a line from ``start`` leaves the tissue for good; None when it meets tissue again."""
    step = 0.25 * tissue.grid.spacing_mm
    far = tissue.bounds[(side + 1) // 2, axis] + side * 4.0 * step
    line = np.repeat(start[None], max(2, int(abs(far - start[axis]) / step) + 2), axis=0)
    line[:, axis] = np.linspace(start[axis], far, len(line))
    inside = tissue.contains(line)
    leaves = int(np.argmin(inside))
    if inside[leaves:].any():
        return None
    within, beyond = line[leaves - 1], line[leaves]
    depth = tissue.grid.distance(np.stack([within, beyond]))
    out: FloatArray = within + (beyond - within) * (depth[0] / (depth[0] - depth[1]))
    return out


def _is_free(
    node: int, end: FloatArray, nodes: FloatArray, bonds: IntArray, need: FloatArray
) -> bool:
    """Whether the way from ``node`` to ``end`` keeps ``need`` (m,), mm, from other bonds' axes."""
    start = nodes[node]
    low, high = np.minimum(start, end) - need.max(), np.maximum(start, end) + need.max()
    both = nodes[bonds]
    near = ((both.min(axis=1) <= high) & (both.max(axis=1) >= low)).all(axis=1)
    near &= (bonds != node).all(axis=1)
    return all(
        segment_segment(*start, *end, *both[k, 0], *both[k, 1])[0] >= need[k]
        for k in np.flatnonzero(near)
    )
