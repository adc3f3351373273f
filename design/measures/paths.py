"""Measure inlet-to-outlet paths of a network: vessels per path, and tortuosity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from design.network import VesselNetwork
from kernels import jit
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class FlowPaths:
    """Depth and tortuosity of a network's flow paths.

    Attributes
    ----------
    depth_mean, depth_max : float, int
        Vessels from an inlet to each outlet, by the way of fewest vessels; where there are more
        inlets than outlets, as in veins, from an outlet to each inlet.
    tortuosity_mean, tortuosity_p95, tortuosity_max : float
        Length of that way over the straight distance of its ends.
    vessel_tortuosity_mean, vessel_tortuosity_max : float
        The same for single vessels; those that return to where they began are left out.
    """

    depth_mean: float
    depth_max: int
    tortuosity_mean: float
    tortuosity_p95: float
    tortuosity_max: float
    vessel_tortuosity_mean: float
    vessel_tortuosity_max: float


def measure_paths(network: VesselNetwork) -> FlowPaths | None:
    """Measure the ways from inlets to outlets; None when no outlet can be reached from one."""
    inlets, outlets = network.inlets(), network.outlets()
    if len(inlets) > len(outlets):
        inlets, outlets = outlets, inlets
    depth, way, source = paths_from(network, inlets)
    outlets = outlets[depth[outlets] > 0]
    if len(outlets) == 0:
        return None
    turns = _over_chord(way[outlets], network.nodes[outlets] - network.nodes[source[outlets]])
    first, last = network.points[network.offset[:-1]], network.points[network.offset[1:] - 1]
    own = _over_chord(network.lengths(), last - first)
    return FlowPaths(
        depth_mean=float(depth[outlets].mean()),
        depth_max=int(depth[outlets].max()),
        tortuosity_mean=float(turns.mean()),
        tortuosity_p95=float(np.percentile(turns, 95.0)),
        tortuosity_max=float(turns.max()),
        vessel_tortuosity_mean=float(own.mean()),
        vessel_tortuosity_max=float(own.max()),
    )


def _over_chord(length: FloatArray, chord: FloatArray) -> FloatArray:
    """Lengths over chords, at least 1; 1 alone where every chord is nought."""
    straight = np.linalg.norm(chord, axis=1)
    real = straight > 0.0
    ratio: FloatArray = np.maximum(length[real] / straight[real], 1.0)
    return ratio if len(ratio) else np.ones(1)


def paths_from(network: VesselNetwork, sources: IntArray) -> tuple[IntArray, FloatArray, IntArray]:
    """Find the path of fewest vessels to each node from the nearest of some nodes.

    Returns
    -------
    depth : (m,) int64
        Vessels of the path; -1 where there is none.
    length : (m,) float64, mm
    source : (m,) int64
        Where it begins; -1 where there is none.
    """
    ends, nodes = network.vessel_nodes, len(network.nodes)
    both = np.concatenate([ends, ends[:, ::-1]])
    order = np.argsort(both[:, 0], kind="stable")
    begin = np.searchsorted(both[order, 0], np.arange(nodes + 1))
    depth, length, source = _spread(
        begin, both[order, 1], order % len(ends), network.lengths(), sources
    )
    return depth, length, source


@jit
def _spread(begin: Any, other: Any, vessel: Any, length: Any, inlets: Any) -> Any:
    nodes = len(begin) - 1
    depth = np.full(nodes, -1)
    source = np.full(nodes, -1)
    way = np.zeros(nodes)
    queue = np.empty(nodes, np.int64)
    tail = 0
    for node in inlets:
        depth[node] = 0
        source[node] = node
        queue[tail] = node
        tail += 1
    head = 0
    while head < tail:
        node = queue[head]
        head += 1
        for k in range(begin[node], begin[node + 1]):
            to = other[k]
            if depth[to] >= 0:
                continue
            depth[to] = depth[node] + 1
            source[to] = source[node]
            way[to] = way[node] + length[vessel[k]]
            queue[tail] = to
            tail += 1
    return depth, way, source
