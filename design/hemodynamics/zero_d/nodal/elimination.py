"""Branches of a network folded onto what they hang on, in linear time and without cancellation.

A node i of pressure p_i with one vessel left, of conductance g to node j, and with all else on it
summed up as a conductance G to ground and a source s (Norton's equivalent), obeys

    g (p_j - p_i) = G p_i - s.

Seen from j it is a conductance G σ and a source s σ with σ = g/(g + G); and once p_j is known,

    p_i = σ p_j + s/(g + G),    Q_{j→i} = σ (G p_j - s).

Every term is a sum or product of positive numbers where s = 0, so flows come out right to
rounding however far conductances lie apart. Complex admittances of a frequency obey the same. A
tree folds up to a single node; of a graph with loops its core remains.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.network import FloatArray, IntArray
from kernels import jit


@jit
def peel(
    first: IntArray, last: IntArray, inner: NDArray[np.bool_], count: int
) -> tuple[IntArray, IntArray]:
    """Order in which unknowns can be folded away, and the vessel that each then still has.

    ``inner`` marks the vessels between two unknowns. The one vessel a node has left is the
    exclusive or of the numbers of all that it had and has lost: no adjacency list is needed.
    """
    degree = np.zeros(count, dtype=np.int64)
    left = np.zeros(count, dtype=np.int64)
    for vessel in range(len(first)):
        if inner[vessel]:
            for node in (first[vessel], last[vessel]):
                degree[node] += 1
                left[node] ^= vessel
    order = np.empty(count, dtype=np.int64)
    by = np.empty(count, dtype=np.int64)
    folded = 0
    for start in range(count):
        node = start
        while degree[node] == 1:
            vessel = left[node]
            order[folded], by[folded] = node, vessel
            folded += 1
            degree[node] = 0
            node = first[vessel] + last[vessel] - node
            degree[node] -= 1
            left[node] ^= vessel
            # Nodes further on will be met by the outer loop.
            if node > start:
                break
    return order[:folded], by[:folded]


@jit
def fold(
    order: IntArray, by: IntArray, ends_sum: IntArray, conductance: FloatArray, ground: FloatArray
) -> FloatArray:
    """σ of each folded node; ``ground`` (s,) gains the folded conductances in place."""
    share = np.empty(len(order), conductance.dtype)
    for k in range(len(order)):
        node, g = order[k], conductance[by[k]]
        share[k] = g / (g + ground[node])
        ground[ends_sum[by[k]] - node] += ground[node] * share[k]
    return share


@jit
def gather(
    order: IntArray, by: IntArray, ends_sum: IntArray, share: FloatArray, source: FloatArray
) -> None:
    """Carry the sources of folded nodes to what they hang on, in place."""
    for k in range(len(order)):
        source[ends_sum[by[k]] - order[k]] += source[order[k]] * share[k]


@jit
def unfold(
    order: IntArray,
    by: IntArray,
    first: IntArray,
    last: IntArray,
    share: FloatArray,
    conductance: FloatArray,
    ground: FloatArray,
    source: FloatArray,
    pressure: FloatArray,
    flow: FloatArray,
) -> None:
    """Pressure of each folded node and flow of its vessel, from the last folded to the first."""
    for k in range(len(order) - 1, -1, -1):
        node, vessel = order[k], by[k]
        other = first[vessel] + last[vessel] - node
        g = conductance[vessel]
        pressure[node] = share[k] * pressure[other] + source[node] / (g + ground[node])
        towards_node = share[k] * (ground[node] * pressure[other] - source[node])
        flow[vessel] = towards_node if last[vessel] == node else -towards_node
