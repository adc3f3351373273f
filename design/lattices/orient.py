"""Direct a channel graph's edges from one source to one sink node, so that no flow circulates."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from kernels.arrays import FloatArray, IntArray


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
