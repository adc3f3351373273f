"""Compute the genus of a network's lumen surface, and of a body with the lumens cut out.

A lumen's surface is that of a thickened graph: its genus is the number of independent loops,
vessels - nodes + parts. Cut out of a body through p ports, each part of the lumen gives its g
loops and joins p places of the outer surface, so g + p - 1 handles more; a part without a port is
a closed cavity with a surface of its own and adds its g.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from design.network import VesselNetwork
from kernels.arrays import IntArray


def network_genus(network: VesselNetwork) -> int:
    """Genus of the network's lumen surface: its independent loops, summed over its parts."""
    used = int(np.sum(network.degree() > 0))
    return network.vessel_count - used + len(np.unique(_part_of_node(network)[1]))


def construct_genus(network: VesselNetwork, ports: IntArray, body_genus: int = 0) -> int:
    """Genus of a body minus the network's lumens, open at the nodes ``ports`` (k,).

    Parameters
    ----------
    network : VesselNetwork
        Vessels that aren't joined mustn't touch.
    ports : (k,) int64
        Free ends that open through the body's surface.
    body_genus : int
        Of the body before.
    """
    part = _part_of_node(network)[0]
    opened = len(np.unique(part[np.asarray(ports, dtype=np.int64)]))
    return body_genus + network_genus(network) + len(ports) - opened


def _part_of_node(network: VesselNetwork) -> tuple[IntArray, IntArray]:
    """Number of the connected part of each node, and of each vessel."""
    first, last = network.vessel_nodes.T
    shape = (len(network.nodes), len(network.nodes))
    joined = coo_array((np.ones(len(first), dtype=np.int8), (first, last)), shape=shape)
    part = connected_components(joined, directed=False)[1].astype(np.int64)
    return part, part[first]
