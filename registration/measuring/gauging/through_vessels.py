"""Cut a vessel network down to vessels that join inlet and outlet, without dead ends."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from design.network import VesselNetwork
from kernels.arrays import BoolArray, IntArray


def connected_vessels(
    network: VesselNetwork, kept: BoolArray, inlets: tuple[int, ...], outlets: tuple[int, ...]
) -> BoolArray:
    """Of the kept vessels, those that hang together with an inlet and an outlet."""
    rows, columns = network.vessel_nodes[kept].T
    count = len(network.nodes)
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    both = np.intersect1d(label[list(inlets)], label[list(outlets)])
    return np.asarray(kept & np.isin(label[network.vessel_nodes[:, 0]], both))


def sub_network(network: VesselNetwork, vessels: IntArray) -> tuple[VesselNetwork, dict[int, int]]:
    """A network of some of the vessels, and the new number of each of their nodes."""
    used, ends = np.unique(network.vessel_nodes[vessels], return_inverse=True)
    lines = [network.polyline(int(vessel)) for vessel in vessels]
    part = VesselNetwork(
        nodes=network.nodes[used],
        vessel_nodes=ends.reshape(-1, 2),
        kind=network.kind[vessels],
        tree=network.tree[vessels],
        offset=np.concatenate([[0], np.cumsum([len(points) for points, _ in lines])]),
        points=np.concatenate([points for points, _ in lines]),
        radius=np.concatenate([radius for _, radius in lines]),
    )
    return part, {int(node): index for index, node in enumerate(used)}


def drop_dead_ends(network: VesselNetwork, kept: BoolArray, ends: IntArray) -> BoolArray:
    """Of the kept vessels, those that don't lead to nowhere but ``ends``, the inlets and outlets.

    Nothing flows in a dead end; left in, it would be taken for an inlet or an outlet.
    """
    kept = kept.copy()
    while True:
        degree = np.bincount(network.vessel_nodes[kept].ravel(), minlength=len(network.nodes))
        degree[ends] += 1
        dead = kept & (degree[network.vessel_nodes] == 1).any(axis=1)
        if not dead.any():
            return kept
        kept &= ~dead
