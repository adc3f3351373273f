"""Chain straight pieces of a `network.csv` into vessel polylines between nodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from design.network import VesselNetwork
from design.network_files.csv_format.pieces import GAP_MM, Pieces
from kernels.arrays import FloatArray, IntArray


def chain_pieces(pieces: Pieces) -> VesselNetwork:
    """Make a network of pieces in any order.

    A node of the file stays a node where its degree isn't 2, where the vessel's number changes,
    or where the radius jumps: a polyline has one radius a point, so the vessel is cut there and
    nothing is lost. The other nodes become inner points. Vessels keep the order in which they
    first appear, nodes that of their numbers.

    Raises
    ------
    NetworkError
        A vessel's pieces form no chain, differ in kind or tree, leave a gap, or have no length.
    """
    labels, node = np.unique(pieces.nodes, return_inverse=True)
    node = node.reshape(-1, 2)
    position = _node_positions(pieces, node, len(labels))
    row = _rows_in_flow_order(pieces)
    node, radius = node[row], pieces.radius[row]
    _check_same_kind(pieces, row)

    degree = np.bincount(node.ravel())
    inner = (
        (pieces.vessel[row[:-1]] == pieces.vessel[row[1:]])
        & (node[:-1, 1] == node[1:, 0])
        & (degree[node[:-1, 1]] == 2)
        & (radius[:-1, 1] == radius[1:, 0])
    )
    first = np.flatnonzero(np.r_[True, ~inner])
    count = np.diff(np.r_[first, len(row)])
    last = first + count - 1
    offset = np.r_[0, np.cumsum(count + 1)]
    # A vessel of k pieces has k + 1 points: each piece's start, then the last piece's end.
    is_end = np.zeros(offset[-1], dtype=bool)
    is_end[offset[1:] - 1] = True
    point_node = np.empty(offset[-1], dtype=np.int64)
    point_radius = np.empty(offset[-1])
    point_node[~is_end], point_node[is_end] = node[:, 0], node[last, 1]
    point_radius[~is_end], point_radius[is_end] = radius[:, 0], radius[last, 1]
    kept, ends = np.unique(np.stack([node[first, 0], node[last, 1]], 1), return_inverse=True)

    network = VesselNetwork(
        nodes=position[kept],
        vessel_nodes=ends.reshape(-1, 2),
        kind=pieces.kind[row[first]],
        tree=pieces.tree[row[first]],
        offset=offset,
        points=position[point_node],
        radius=point_radius,
    )
    flat = network.lengths() == 0
    if flat.any():
        pieces.fail(int(row[first[np.argmax(flat)]]), "zero length; move or remove it")
    return network


def fuse_vessels(pieces: Pieces, fusible: NDArray[np.bool_]) -> Pieces:
    """Give vessels of one kind and tree that go on in each other the same number.

    Parameters
    ----------
    pieces : Pieces
    fusible : (m,) bool
        Nodes, by number, at which they may.
    """
    nodes = pieces.nodes
    ends = np.full((2, len(fusible)), -1, dtype=np.int64)
    for side in (0, 1):
        ends[side, nodes[:, 1 - side]] = np.arange(len(pieces))
    degree = np.bincount(nodes.ravel(), minlength=len(fusible))
    into, out = ends[:, fusible & (degree == 2) & (ends >= 0).all(axis=0)]
    alike = (pieces.kind[into] == pieces.kind[out]) & (pieces.tree[into] == pieces.tree[out])
    links = pieces.vessel[np.stack([into, out])[:, alike]]
    size = int(pieces.vessel.max()) + 1
    graph = coo_matrix((np.ones(links.shape[1]), links), shape=(size, size))
    return replace(pieces, vessel=connected_components(graph, directed=False)[1][pieces.vessel])


def join_equal_points(pieces: Pieces) -> Pieces:
    """Make one node of points at the same place, to the bit, and one piece of equal pieces.

    Pieces without length are left out, and of pieces of one kind between the same two points all
    but the first. What is left of a vessel in several runs is several vessels.
    """
    flat = pieces.points.reshape(-1, 3)
    _, first, node = np.unique(flat, axis=0, return_index=True, return_inverse=True)
    nodes = first[node.reshape(-1, 2)]
    key = np.column_stack([np.sort(nodes, axis=1), pieces.kind])
    row = np.sort(np.unique(key, axis=0, return_index=True)[1])
    row = row[nodes[row, 0] != nodes[row, 1]]
    follows = (pieces.vessel[row[1:]] == pieces.vessel[row[:-1]]) & (
        nodes[row[1:], 0] == nodes[row[:-1], 1]
    )
    return Pieces(
        path=pieces.path,
        line=pieces.line[row],
        vessel=np.cumsum(np.r_[True, ~follows]) - 1 if len(row) else pieces.vessel[row],
        nodes=nodes[row],
        points=pieces.points[row],
        radius=pieces.radius[row],
        kind=pieces.kind[row],
        tree=pieces.tree[row],
    )


def _node_positions(pieces: Pieces, node: IntArray, count: int) -> FloatArray:
    """Where each node is first said to be; every other mention must agree."""
    flat, points = node.ravel(), pieces.points.reshape(-1, 3)
    first = np.full(count, len(flat), dtype=np.int64)
    np.minimum.at(first, flat, np.arange(len(flat)))
    gap = np.linalg.norm(points - points[first[flat]], axis=1)
    worst = int(np.argmax(gap))
    if gap[worst] > GAP_MM:
        here, there = worst // 2, int(first[flat[worst]]) // 2
        pieces.fail(
            here,
            f"node {pieces.nodes.ravel()[worst]} lies {gap[worst]:g} mm from where line "
            f"{pieces.line[there]} has it (at most {GAP_MM:g} mm); close the gap or use "
            "another node number",
        )
    return points[first]


def _rows_in_flow_order(pieces: Pieces) -> IntArray:
    """Rows sorted by vessel (in order of first appearance) and along each vessel's flow."""
    _, first, vessel = np.unique(pieces.vessel, return_index=True, return_inverse=True)
    row = np.argsort(first[vessel], kind="stable")
    starts = np.flatnonzero(np.diff(first[vessel][row], prepend=-1))
    ends = np.r_[starts[1:], len(row)]
    joined = pieces.nodes[row[:-1], 1] == pieces.nodes[row[1:], 0]
    breaks = np.r_[0, np.cumsum(~joined)]
    # Files are mostly in order already; only the other vessels take the slow way.
    for start, end in zip(starts, ends, strict=True):
        if breaks[end - 1] != breaks[start]:
            row[start:end] = _sorted_chain(pieces, row[start:end])
    return row


def _sorted_chain(pieces: Pieces, rows: IntArray) -> IntArray:
    """Rows of one vessel, each piece after the one that ends where it starts."""
    leaving: dict[int, int] = {}
    entering: dict[int, int] = {}
    for row in rows.tolist():
        for node, seen, doing in zip(
            pieces.nodes[row].tolist(), (leaving, entering), ("leave", "enter"), strict=True
        ):
            if node in seen:
                pieces.fail(
                    row,
                    f"this piece and that in line {pieces.line[seen[node]]} both {doing} node "
                    f"{node}; a vessel doesn't branch: turn the piece round or give it a vessel "
                    "number of its own",
                )
            seen[node] = row
    heads = [row for node, row in leaving.items() if node not in entering]
    chain = [heads[0] if heads else int(rows[0])]
    while (row_after := leaving.get(int(pieces.nodes[chain[-1], 1]))) not in (None, chain[0]):
        chain.append(row_after)
    if len(chain) != len(rows):
        stray = next(row for row in rows.tolist() if row not in set(chain))
        pieces.fail(
            stray,
            f"broken chain: the piece from node {pieces.nodes[stray, 0]} to "
            f"{pieces.nodes[stray, 1]} isn't joined to the vessel's piece in line "
            f"{pieces.line[chain[-1]]}; share the node's number or give it another vessel number",
        )
    return np.array(chain, dtype=np.int64)


def _check_same_kind(pieces: Pieces, row: IntArray) -> None:
    same = pieces.vessel[row[:-1]] == pieces.vessel[row[1:]]
    for name, values in (("kind", pieces.kind[row]), ("tree", pieces.tree[row])):
        differs = same & (values[:-1] != values[1:])
        if differs.any():
            pieces.fail(
                int(row[1 + np.argmax(differs)]),
                f"its {name} differs from that of its vessel's other pieces; a vessel has one",
            )
