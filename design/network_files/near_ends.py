"""Join ends of vessels that lie within the lumen's middle at another's node.

Exporters write a daughter's first point beside the node that it leaves: rounded, or on the parent's
wall. Read as it stands the daughter would be a network of its own.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from design.network import VesselNetwork
from design.network_files.merge import NetworkWithNotes
from kernels.arrays import FloatArray, IntArray

REACH: Final = 0.5
"""Of the thinner radius of the two: ends so near are one place. Vessels of their own that end so
near to each other would overlap."""


def join_near_ends(network: VesselNetwork) -> NetworkWithNotes:
    """Return the network with free ends joined to the nearest node within `REACH`, and a note.

    A point of another vessel at which a free end lies becomes a node. The end moves, the node
    stays. A node is where vessels meet, or where one ends that the other continues: two first ends
    side by side are lines through one lumen, or two inlets.
    """
    network = _split(network, _points_at_ends(network))
    nodes, points = network.vessel_nodes.copy(), network.points.copy()
    radius = _widest_at_nodes(network)
    degree = network.degree()
    free = degree[nodes] == 1
    ends_there = np.zeros(len(network.nodes), dtype=np.int64)
    ends_there[nodes] = [0, 1]  # which end of its vessel a node of one vessel is
    used = np.unique(nodes)
    near = cKDTree(network.nodes[used])
    moved: list[float] = []
    for vessel, side in np.argwhere(free).tolist():
        own, other = nodes[vessel, side], nodes[vessel, 1 - side]
        row = network.offset[vessel] if side == 0 else network.offset[vessel + 1] - 1
        reach = REACH * float(network.radius[row])
        here = used[near.query_ball_point(network.nodes[own], reach)]
        gaps = np.linalg.norm(network.nodes[here] - network.nodes[own], axis=1)
        for away, target in sorted(zip(gaps.tolist(), here.tolist(), strict=True)):
            # A node whose vessels have all moved away is none any more.
            if target in (own, other) or away > REACH * radius[target] or target not in nodes:
                continue
            if degree[target] == 1 and ends_there[target] == side:
                continue
            nodes[vessel, side], points[row] = target, network.nodes[target]
            moved.append(away)
            break
    if not moved:
        return NetworkWithNotes(network, ())
    kept, number = np.unique(nodes, return_inverse=True)
    joined = replace(
        network,
        nodes=network.nodes[kept],
        vessel_nodes=number.reshape(nodes.shape),
        points=points,
    )
    ends = "1 end" if len(moved) == 1 else f"{len(moved)} ends"
    note = (
        f"{ends} of vessels that lay beside a node, {max(moved):.3g} mm from it at most (limit: "
        f"half the radius), joined to it."
    )
    return NetworkWithNotes(joined, (note,))


def _points_at_ends(network: VesselNetwork) -> IntArray:
    """Rows of inner points of other vessels that a free end lies nearest to, within `REACH`."""
    first, last = network.offset[:-1], network.offset[1:] - 1
    of = np.repeat(np.arange(network.vessel_count), np.diff(network.offset))
    inner = np.setdiff1d(np.arange(len(network.points)), np.concatenate([first, last]))
    ends = np.column_stack([first, last])[network.degree()[network.vessel_nodes] == 1]
    if not len(inner) or not len(ends):
        return np.zeros(0, dtype=np.int64)
    away, row = cKDTree(network.points[inner]).query(network.points[ends])
    row = inner[row]
    near = away <= REACH * np.minimum(network.radius[ends], network.radius[row])
    to_node, _ = cKDTree(network.nodes[np.unique(network.vessel_nodes)]).query(
        network.points[ends], k=2
    )
    return np.unique(row[near & (of[row] != of[ends]) & (away < to_node[:, 1])])


def _split(network: VesselNetwork, rows: IntArray) -> VesselNetwork:
    """Return the network with vessels cut in two at inner points."""
    if not len(rows):
        return network
    starts = np.sort(np.concatenate([network.offset[:-1], rows]))
    ends = np.sort(np.concatenate([network.offset[1:] - 1, rows]))
    vessel = np.searchsorted(network.offset, starts, side="right") - 1
    node = np.full(len(network.points), -1)
    node[rows] = len(network.nodes) + np.arange(len(rows))
    begins = np.where(node[starts] < 0, network.vessel_nodes[vessel, 0], node[starts])
    closes = np.where(node[ends] < 0, network.vessel_nodes[vessel, 1], node[ends])
    kept = np.concatenate([np.arange(a, b + 1) for a, b in zip(starts, ends, strict=True)])
    return VesselNetwork(
        nodes=np.vstack([network.nodes, network.points[rows]]),
        vessel_nodes=np.column_stack([begins, closes]),
        kind=network.kind[vessel],
        tree=network.tree[vessel],
        offset=np.concatenate([[0], np.cumsum(ends - starts + 1)]),
        points=network.points[kept],
        radius=network.radius[kept],
    )


def _widest_at_nodes(network: VesselNetwork) -> FloatArray:
    """Largest radius of the vessels that end at each node, (m,), mm."""
    out = np.zeros(len(network.nodes))
    first, last = network.offset[:-1], network.offset[1:] - 1
    np.maximum.at(out, network.vessel_nodes[:, 0], network.radius[first])
    np.maximum.at(out, network.vessel_nodes[:, 1], network.radius[last])
    return out
