"""Eliminate a graph's dead-end branches leaf by leaf; recover their pressures and flows.

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

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kernels import jit
from kernels.arrays import IntArray

Numbers = NDArray[Any]
"""Real or complex."""


@jit
def folding_order(
    first: IntArray, last: IntArray, fixed: NDArray[np.bool_]
) -> tuple[IntArray, IntArray, IntArray]:
    """Order in which unknowns can be folded away, along which vessel, and onto which unknown.

    The one vessel a node has left is the exclusive or of the numbers of all that it had and has
    lost: no adjacency list is needed.
    """
    count = len(fixed)
    degree = np.zeros(count, dtype=np.int64)
    left = np.zeros(count, dtype=np.int64)
    for vessel in range(len(first)):
        a, b = first[vessel], last[vessel]
        if not (fixed[a] or fixed[b] or a == b):
            degree[a] += 1
            left[a] ^= vessel
            degree[b] += 1
            left[b] ^= vessel
    order = np.empty(count, dtype=np.int64)
    by = np.empty(count, dtype=np.int64)
    onto = np.empty(count, dtype=np.int64)
    folded = 0
    # From the last: where parents come before their children, a sweep back meets leaves first.
    for start in range(count - 1, -1, -1):
        node = start
        while degree[node] == 1:
            vessel = left[node]
            other = first[vessel] + last[vessel] - node
            order[folded], by[folded], onto[folded] = node, vessel, other
            folded += 1
            degree[node] = 0
            node = other
            degree[node] -= 1
            left[node] ^= vessel
            # Nodes further down will be met by the outer loop.
            if node < start:
                break
    return order[:folded].copy(), by[:folded].copy(), onto[:folded].copy()


@jit
def ground_given_pressures(
    vessels: IntArray, free: IntArray, conductance: Numbers, ground: Numbers
) -> None:
    """Conductances of vessels to given pressures become ones to ground, in place."""
    for k in range(len(vessels)):
        ground[free[k]] += conductance[vessels[k]]


@jit
def add_driven_sources(
    vessels: IntArray,
    free: IntArray,
    held: IntArray,
    conductance: Numbers,
    pressure: Numbers,
    source: Numbers,
) -> None:
    """And what these pressures drive through them become sources, in place."""
    for k in range(len(vessels)):
        source[free[k]] += conductance[vessels[k]] * pressure[held[k]]


@jit
def fold(
    order: IntArray,
    by: IntArray,
    onto: IntArray,
    conductance: Numbers,
    ground: Numbers,
    share: Numbers,
) -> None:
    """σ of each folded node (k,); ``ground`` (s,) gains the folded conductances, both in place."""
    for k in range(len(order)):
        node, g = order[k], conductance[by[k]]
        share[k] = g / (g + ground[node])
        ground[onto[k]] += ground[node] * share[k]


@jit
def gather(order: IntArray, onto: IntArray, share: Numbers, source: Numbers) -> None:
    """Carry the sources of folded nodes to what they hang on, in place."""
    for k in range(len(order)):
        source[onto[k]] += source[order[k]] * share[k]


@jit
def unfold(
    order: IntArray,
    by: IntArray,
    onto: IntArray,
    last: IntArray,
    share: Numbers,
    conductance: Numbers,
    ground: Numbers,
    source: Numbers,
    pressure: Numbers,
    flow: Numbers,
) -> None:
    """Pressure of each folded node and flow of its vessel, from the last folded to the first."""
    for k in range(len(order) - 1, -1, -1):
        node, vessel, beyond = order[k], by[k], pressure[onto[k]]
        g, to_ground, here = conductance[vessel], ground[node], source[node]
        pressure[node] = share[k] * beyond + here / (g + to_ground)
        towards_node = share[k] * (to_ground * beyond - here)
        flow[vessel] = towards_node if last[vessel] == node else -towards_node


@jit
def flows_between_known(
    vessels: IntArray,
    first: IntArray,
    last: IntArray,
    conductance: Numbers,
    pressure: Numbers,
    flow: Numbers,
) -> None:
    """Flow of vessels between known pressures, in place."""
    for k in range(len(vessels)):
        v = vessels[k]
        flow[v] = conductance[v] * (pressure[first[v]] - pressure[last[v]])


@jit
def largest_imbalance(
    first: IntArray,
    last: IntArray,
    fixed: NDArray[np.bool_],
    flow: Numbers,
    net: Numbers,
    through: NDArray[np.float64],
) -> float:
    """Take flows from what goes into each unknown, in place, and find the most that is left.

    ``net`` and ``through`` (s,) come with what else goes in; where the pressure is given nothing
    is left.
    """
    for v in range(len(first)):
        a, b, q = first[v], last[v], flow[v]
        net[a] -= q
        net[b] += q
        through[a] += abs(q)
        through[b] += abs(q)
    worst = 0.0
    for node in range(len(fixed)):
        if fixed[node]:
            net[node] = 0.0
        elif through[node] > 0.0:
            worst = max(worst, abs(net[node]) / through[node])
    return worst
