"""Topology of triangle meshes: merged vertices, twin half-edges, closedness, shells, genus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.geometry.mesh import connected_parts, edges_of
from design.network import VesselNetwork
from kernels import jit
from kernels.arrays import IntArray


@dataclass(frozen=True)
class EdgeFaults:
    """Edges that a closed, oriented surface doesn't have.

    Attributes
    ----------
    open : int
        With a face on one side only.
    wrong : int
        With more than two faces, or with two that walk it in the same direction.
    """

    open: int
    wrong: int

    def __bool__(self) -> bool:
        return self.open + self.wrong > 0


def is_closed(faces: NDArray[np.integer], *, touching: bool = False) -> bool:
    """Whether each edge of ``faces`` (m, 3) is walked once in either direction.

    With ``touching`` as often in one as in the other: sheets may share an edge.
    """
    if not touching:
        return not bool(np.any(pair_half_edges(faces) < 0))
    tail = np.asarray(faces, dtype=np.int64)
    head = np.roll(tail, -1, axis=1).ravel()
    tail = tail.ravel()
    count = int(tail.max(initial=0)) + 1
    there, back = np.sort(tail * count + head), np.sort(head * count + tail)
    return bool(np.array_equal(there, back))


def edge_faults(faces: NDArray[np.integer]) -> EdgeFaults:
    """Count the faulty edges of ``faces`` (m, 3)."""
    if is_closed(faces):
        return EdgeFaults(0, 0)
    edges = edges_of(faces)
    single = edges.uses == 1
    wrong = ~single & ((edges.uses != 2) | (edges.balance != 0))
    return EdgeFaults(int(single.sum()), int(wrong.sum()))


def faulty_vertices(faces: NDArray[np.integer]) -> IntArray:
    """Vertices of all edges that more or fewer than two faces share."""
    edges = edges_of(faces)
    return np.unique(edges.ends[edges.uses != 2])


def surface_genus(faces: NDArray[np.integer]) -> tuple[int, int]:
    """Total genus and number of shells of a closed, oriented surface.

    Euler: Σ (2 - 2 g) over the shells = vertices - edges + faces with edges = 3/2 faces. A vertex
    is a closed fan of triangle corners here: one in which two fans touch counts twice, as two
    shells that touch in a point are still two.

    Parameters
    ----------
    faces : (m, 3)
        Without `edge_faults`.
    """
    twin = pair_half_edges(faces)
    _, fans = corner_fan_numbers(twin)
    euler = fans - len(faces) // 2
    shells = int(count_shells(twin))
    return shells - euler // 2, shells


def vertex_parts(faces: NDArray[np.integer], count: int) -> IntArray:
    """Return the number of the connected part of ``faces`` (m, 3) at each of ``count`` vertices."""
    return connected_parts(faces[:, [0, 1, 1, 2]].reshape(-1, 2), count)


def corner_fans(faces: NDArray[np.integer]) -> IntArray:
    """Number of the fan that each corner (m, 3) of a closed surface belongs to.

    A vertex in which two fans touch has two numbers, so that one may be changed without the other.
    """
    fan, _ = corner_fan_numbers(pair_half_edges(faces))
    return np.asarray(fan).reshape(-1, 3)


def pair_half_edges(faces: NDArray[np.integer]) -> IntArray:
    """The half-edge opposite each of ``faces`` (m, 3), (3 m,).

    -1 where an edge hasn't exactly two sides that run along it in opposite directions.

    Half-edge 3 t + i runs from corner i of triangle t to its next corner. Sorted by the lesser of
    its two vertices, an edge's sides stand among a dozen others: no sort of all keys is needed.
    """
    corners = np.ascontiguousarray(faces, dtype=np.int64)
    return np.asarray(_pair(corners, int(corners.max(initial=-1)) + 1))


@jit
def _pair(faces: Any, count: int) -> Any:
    """As `pair_half_edges`; ``count`` vertices."""
    begin = np.zeros(count + 1, np.int64)
    for t in range(len(faces)):
        for i in range(3):
            begin[min(faces[t, i], faces[t, (i + 1) % 3]) + 1] += 1
    for v in range(count):
        begin[v + 1] += begin[v]
    place = begin[:-1].copy()
    half, other = np.empty(3 * len(faces), np.int64), np.empty(3 * len(faces), np.int64)
    for t in range(len(faces)):
        for i in range(3):
            tail, head = faces[t, i], faces[t, (i + 1) % 3]
            at = place[min(tail, head)]
            place[min(tail, head)] += 1
            half[at], other[at] = 3 * t + i, max(tail, head)
    twin = np.full(3 * len(faces), -1, np.int64)
    for v in range(count):
        for m in range(begin[v], begin[v + 1]):
            partner, sides = np.int64(-1), 0
            for n in range(begin[v], begin[v + 1]):
                if other[n] == other[m]:
                    sides += 1
                    if n != m:
                        partner = half[n]
            h = half[m]
            if sides == 2 and faces[h // 3, h % 3] == faces[partner // 3, (partner + 1) % 3]:
                # An edge from a vertex to itself has no opposite side.
                twin[h] = partner if other[m] != v else -1
    return twin


@jit
def corner_fan_numbers(twin: Any) -> tuple[Any, int]:
    """Number of the fan about its vertex that each corner (3 m,) belongs to, and how many.

    ``twin`` (3 m,) pairs all half-edges.
    """
    fan = np.full(len(twin), -1, np.int64)
    count = 0
    for h in range(len(twin)):
        if fan[h] >= 0:
            continue
        at = h
        while fan[at] < 0:
            fan[at] = count
            at = twin[at + 2 if at % 3 == 0 else at - 1]
        count += 1
    return fan, count


@jit
def count_shells(twin: Any) -> int:
    """How many closed surfaces the faces make that aren't joined over an edge."""
    faces = len(twin) // 3
    seen = np.zeros(faces, np.bool_)
    stack = np.empty(faces, np.int64)
    count = 0
    for start in range(faces):
        if seen[start]:
            continue
        count += 1
        seen[start] = True
        stack[0], top = start, 1
        while top > 0:
            top -= 1
            t = stack[top]
            for i in range(3):
                after = twin[3 * t + i] // 3
                if not seen[after]:
                    seen[after] = True
                    stack[top] = after
                    top += 1
    return count


def network_genus(network: VesselNetwork) -> int:
    """Genus of the network's lumen surface: its independent loops, summed over its parts.

    A lumen's surface is that of a thickened graph: its genus is the number of independent loops,
    vessels - nodes + parts. Cut out of a body through p ports, each part of the lumen gives its g
    loops and joins p places of the outer surface, so g + p - 1 handles more; a part without a port
    is a closed cavity with a surface of its own and adds its g.
    """
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
    part = connected_parts(network.vessel_nodes, len(network.nodes))
    return part, part[network.vessel_nodes[:, 0]]
