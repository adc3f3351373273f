"""Search the shortest collision-free route between two terminals on a lattice, by A*."""

from __future__ import annotations

from heapq import heappop, heappush
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.vasculature.growth.kernels.index import CellIndex
from design.vasculature.loops.curves import (
    ConnectionLimits,
    Ends,
    heading,
    piece_clear,
    point_distance,
)
from design.vasculature.loops.settings import ROUTE
from kernels import jit
from kernels.arrays import FloatArray

NO_WAY, UNDECIDED = 0, -1
"""Results of a search that found no way: it saw all points, or its steps ran out."""
UNSEEN, FREE, TAKEN = 0, 1, 2
"""What is known of a lattice point: nothing, or whether a vessel has room there."""


class Lattice(NamedTuple):
    """Points that a way may pass through, numbered along the last axis first.

    Attributes
    ----------
    low : (3,) float64, mm
        Point (0, 0, 0).
    shape : (3,) int64
    cell : float, mm
    """

    low: FloatArray
    shape: NDArray[np.int64]
    cell: float


class Search(NamedTuple):
    """State of a search.

    Attributes
    ----------
    gone : (n + 1,) float64, mm
        Way from the first end to each lattice point, and to the far end.
    came : (n + 1,) int64
        The point before on that way; -1 for the first end, -2 where none is known.
    state : (n,) int8
        `UNSEEN`, `FREE` or `TAKEN`.
    """

    gone: FloatArray
    came: NDArray[np.int64]
    state: NDArray[np.int8]


@jit
def node_place(node: int, lattice: Lattice, out: Any) -> None:
    """Write the coordinates of a lattice point, mm."""
    low, shape, cell = lattice
    out[2] = low[2] + cell * (node % shape[2])
    node = node // shape[2]
    out[1] = low[1] + cell * (node % shape[1])
    out[0] = low[0] + cell * (node // shape[1])


@jit
def search(
    ends: Ends,
    radius: float,
    lattice: Lattice,
    limits: ConnectionLimits,
    index: CellIndex,
    capsules: Any,
    most: int,
    path: Any,
) -> int:
    """Write the shortest clear path from end to end over a lattice of 26 neighbours; its length.

    A* (Hart, Nilsson & Raphael 1968, doi 10.1109/TSSC.1968.300136), distance to the far end as
    the heuristic. A step is checked only when it would be taken: checks cost far more than the
    heap. First and last steps keep within the limit on kinks.

    Parameters
    ----------
    radius : float, mm
        Of the vessel that is to follow the path.
    lattice : Lattice
    most : int
        Steps checked at most.
    path : (k, 3) float64, mm
        Receives the way, ends included.

    Returns
    -------
    int
        Points of the way; `NO_WAY`, or `UNDECIDED` after ``most`` steps.
    """
    total = lattice.shape[0] * lattice.shape[1] * lattice.shape[2]
    state = Search(
        np.full(total + 1, np.inf), np.full(total + 1, -2, np.int64), np.zeros(total, np.int8)
    )
    here, there = np.empty(3), np.empty(3)
    goal = ends.point[1]
    # Typed by an entry that is taken out again.
    heap = [(0.0, 0.0, -1, -1)]
    heap.pop()
    push_first(heap, ends, limits.min_cosine, lattice)
    steps = 0
    while len(heap) > 0:
        _, g, node, before = heappop(heap)
        if state.came[node] != -2:
            continue
        steps += 1
        if steps > most:
            return UNDECIDED
        if before < 0:
            here[:] = ends.point[0]
        else:
            node_place(before, lattice, here)
        if node == total:
            there[:] = goal
        else:
            node_place(node, lattice, there)
        start = state.gone[before] if before >= 0 else 0.0
        left = point_distance(there, goal)
        if not piece_clear(ends, here, there, start, left, radius, limits, index, capsules):
            continue
        if hairpin(ends, state.came, before, lattice, there):
            continue
        state.came[node], state.gone[node] = before, g
        if node == total:
            return trace(state.came, node, lattice, ends, path)
        if (
            left <= ROUTE.join_spacings * lattice.cell
            and heading(ends, 1, goal, there) >= limits.min_cosine
        ):
            heappush(heap, (g + left, g + left, total, node))
        push_onward(heap, state, node, there, ends, radius, lattice, limits, index, capsules)
    return NO_WAY


@jit
def push_onward(
    heap: Any,
    state: Search,
    node: int,
    place: Any,
    ends: Ends,
    radius: float,
    lattice: Lattice,
    limits: ConnectionLimits,
    index: CellIndex,
    capsules: Any,
) -> None:
    """Push the steps from ``node`` at ``place`` to those of its 26 neighbours that have room."""
    goal, g = ends.point[1], state.gone[node]
    there = np.empty(3)
    shape = lattice.shape
    c = node % shape[2]
    b = (node // shape[2]) % shape[1]
    a = node // (shape[1] * shape[2])
    for i in range(max(0, a - 1), min(shape[0], a + 2)):
        for j in range(max(0, b - 1), min(shape[1], b + 2)):
            for k in range(max(0, c - 1), min(shape[2], c + 2)):
                other = (i * shape[1] + j) * shape[2] + k
                if state.came[other] != -2 or state.state[other] == TAKEN:
                    continue
                node_place(other, lattice, there)
                left = point_distance(there, goal)
                far = g + point_distance(there, place)
                if state.state[other] == UNSEEN:
                    free = piece_clear(
                        ends, there, there, far, left, radius, limits, index, capsules
                    )
                    state.state[other] = FREE if free else TAKEN
                    if not free:
                        continue
                heappush(heap, (far + left, far, other, node))


@jit
def push_first(heap: Any, ends: Ends, straight: float, lattice: Lattice) -> None:
    """Push the steps from the first end to the lattice points near it, within the kink."""
    low, shape, cell = lattice
    here, goal = ends.point[0], ends.point[1]
    there = np.empty(3)
    reach = int(ROUTE.join_spacings) + 1
    centre = np.empty(3, np.int64)
    for x in range(3):
        centre[x] = round((here[x] - low[x]) / cell)
    for i in range(max(0, centre[0] - reach), min(shape[0], centre[0] + reach + 1)):
        for j in range(max(0, centre[1] - reach), min(shape[1], centre[1] + reach + 1)):
            for k in range(max(0, centre[2] - reach), min(shape[2], centre[2] + reach + 1)):
                node = (i * shape[1] + j) * shape[2] + k
                node_place(node, lattice, there)
                far = point_distance(here, there)
                if far <= ROUTE.join_spacings * cell and heading(ends, 0, here, there) >= straight:
                    heappush(heap, (far + point_distance(there, goal), far, node, -1))


@jit
def hairpin(ends: Ends, came: Any, node: int, lattice: Lattice, onward: Any) -> bool:
    """Return whether a step from ``node`` to ``onward`` turns too sharply from the one before."""
    if node < 0:
        return False
    here, there = np.empty(3), np.empty(3)
    node_place(node, lattice, here)
    if came[node] < 0:
        there[:] = ends.point[0]
    else:
        node_place(came[node], lattice, there)
    dot = 0.0
    for x in range(3):
        dot += (here[x] - there[x]) * (onward[x] - here[x])
    return dot < ROUTE.min_turn_cosine * point_distance(here, there) * point_distance(here, onward)


@jit
def trace(came: Any, node: int, lattice: Lattice, ends: Ends, path: Any) -> int:
    """Write the path that ends at the goal's ``node``; `NO_WAY` where ``path`` is too short."""
    count, at = 2, came[node]
    while at >= 0:
        count += 1
        at = came[at]
    if count > len(path):
        return NO_WAY
    path[0], path[count - 1] = ends.point[0], ends.point[1]
    at = came[node]
    for n in range(count - 2, 0, -1):
        node_place(at, lattice, path[n])
        at = came[at]
    return count
