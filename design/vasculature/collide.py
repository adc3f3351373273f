"""Find pieces of a network's vessels that come closer than the required clearance.

Goes in: a network. Comes out: pairs of its pieces that come too close.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from heapq import heappop, heappush
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.errors import NetworkError
from design.geometry.segments import close_pairs
from design.network import VesselNetwork
from kernels import jit
from kernels.arrays import FloatArray, IntArray

MOST_PIECES = 1000
"""Of one vessel, into which it is cut to look where two part."""


@dataclass(frozen=True)
class Collisions:
    """Pairs of straight pieces that share no node and come nearer than the clearance.

    Attributes
    ----------
    pieces : (k, 2) int64
        Colliding pieces, numbered as `VesselNetwork.pieces` gives them, first below second.
    vessels : (k, 2) int64
        Their vessels.
    gap_mm : (k,) float64
        Between their walls; negative where they overlap.
    place_mm : (k, 3) float64
        Midway between their axes where these are nearest.
    joint_pieces : (j, 2) int64
        Pairs as near, but within one joint: the way between them along the vessels is no longer
        than twice the sum of their radii plus the clearance.
    joint_gap_mm : (j,) float64
    """

    pieces: IntArray
    vessels: IntArray
    gap_mm: FloatArray
    place_mm: FloatArray
    joint_pieces: IntArray
    joint_gap_mm: FloatArray

    @property
    def count(self) -> int:
        """Colliding pairs."""
        return len(self.pieces)


def collisions(
    network: VesselNetwork,
    clearance_mm: float = 0.0,
    clearance_ratio: float = 0.0,
    reach: float = 1.0,
    joint_part: float = 1.0,
) -> Collisions:
    """Find all pairs of pieces nearer than the clearance.

    The gap is the distance between axes less both radii there (a tapered piece counts with its
    larger radius). Two pieces that share no node collide when their gap is below the clearance
    and the way between them along the vessels is longer than twice the sum of their radii plus
    the clearance; pieces with no way between them always do.

    Parameters
    ----------
    network : VesselNetwork
    clearance_mm : float
    clearance_ratio : float
        Clearance over the thinner radius of a pair; the larger of the two counts.
    reach : float
        Distance within which pairs are told, over the clearance.
    joint_part : float
        Of the way within which pairs belong to a joint. Below 1, pairs are told that another
        radius would leave to a joint no longer.
    """
    start, end, r0, r1, vessel = network.pieces()
    radius = np.maximum(r0, r1)
    ends, nodes = _piece_nodes(network, vessel)
    pairs, gap, place = close_pairs(
        start, end, radius, ends, reach * clearance_mm, reach * clearance_ratio
    )
    both = radius[pairs].sum(axis=1)
    kept = np.maximum(clearance_mm, clearance_ratio * radius[pairs].min(axis=1))
    limit = joint_part * (2.0 * both + kept)
    length = np.linalg.norm(end - start, axis=1)
    joint = ways_between(pairs, limit, ends, length, nodes) <= limit
    return Collisions(
        pairs[~joint], vessel[pairs[~joint]], gap[~joint], place[~joint], pairs[joint], gap[joint]
    )


def _apart(network: VesselNetwork, pairs: Collisions) -> IntArray:
    """Rows of pairs that aren't one lumen all the way from where their vessels meet.

    Daughters that leave their node side by side overlap for longer than a joint reaches, and are
    one lumen there: pieces that overlap, next to two that share a node or belong to a joint, or
    next to such a pair. Pieces have to be short, a radius or less.
    """
    _, _, _, _, vessel = network.pieces()
    nodes = _piece_nodes(network, vessel)[0].tolist()
    overlaps = pairs.gap_mm < 0
    row = {tuple(pair): k for k, pair in enumerate(pairs.pieces.tolist()) if overlaps[k]}
    joint = set(map(tuple, pairs.joint_pieces.tolist()))

    def beside(one: int, two: int) -> list[tuple[int, int]]:
        near = [(one - 1, two), (one + 1, two), (one, two - 1), (one, two + 1)]
        return [
            (i, j)
            for i, j in near
            if 0 <= i < j < len(vessel) and vessel[[i, j]].tolist() == vessel[[one, two]].tolist()
        ]

    def meet(one: int, two: int) -> bool:
        return (one, two) in joint or bool(set(nodes[one]) & set(nodes[two]))

    due = [
        pair
        for pair, k in row.items()
        if len(set(pairs.vessels[k])) == 2 and any(meet(*one) for one in beside(*pair))
    ]
    merged = set(due)
    while due:
        new = [one for one in beside(*due.pop()) if one in row and one not in merged]
        merged.update(new)
        due += new
    rows = np.array([row[pair] for pair in merged], dtype=np.int64)
    return np.setdiff1d(np.arange(pairs.count), rows)


def _in_short_pieces(network: VesselNetwork) -> VesselNetwork:
    """Return the same network with a point every radius, at most."""
    points, radii = [], []
    for line, radius in network.polylines():
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        count = 1 + min(MOST_PIECES, int(np.ceil(along[-1] / radius.min())))
        at = np.union1d(along, np.linspace(0.0, along[-1], count))
        points.append(np.column_stack([np.interp(at, along, axis) for axis in line.T]))
        radii.append(np.interp(at, along, radius))
    return replace(
        network,
        points=np.vstack(points),
        radius=np.concatenate(radii),
        offset=np.cumsum([0, *map(len, radii)]),
    )


def check_network(network: VesselNetwork, clearance_mm: float = 0.0) -> None:
    """Refuse a network whose vessels cross or come nearer than ``clearance_mm``.

    Vessels that leave a common node side by side may overlap until they part.

    Raises
    ------
    NetworkError
        Naming the two vessels, the place and the gap, or a vessel of no length or given twice.
    """
    length = network.lengths()
    short = np.flatnonzero(length <= 0)
    if len(short):
        raise NetworkError(f"vessel {short[0]} has no length; remove it or mend its points")
    check_given_once(network)
    if collisions(network, clearance_mm).count == 0:
        return
    cut = _in_short_pieces(network)
    pairs = collisions(cut, clearance_mm)
    apart = _apart(cut, pairs)
    if len(apart) == 0:
        return
    worst = int(apart[np.argmin(pairs.gap_mm[apart])])
    one, two = pairs.vessels[worst]
    gap = pairs.gap_mm[worst]
    count = len(np.unique(pairs.vessels[apart], axis=0))
    place = "({:.4g}, {:.4g}, {:.4g})".format(*pairs.place_mm[worst])
    says = f"overlap by {-gap:.3g} mm" if gap < 0 else f"are only {gap:.3g} mm apart"
    needed = f"{clearance_mm:g} mm of clearance is needed" if clearance_mm else "they must not"
    less = ", or lower the clearance" if clearance_mm else ""
    raise NetworkError(
        f"vessels {one} and {two} {says} at {place} mm; {needed} ({count} such pairs of vessels). "
        f"Move them apart or join them at a common node{less}; vasculature.overlaps: tell in a "
        "recipe goes on with a network given so"
    )


def check_given_once(network: VesselNetwork) -> None:
    """Refuse a network in which a straight piece joins the same two nodes as another.

    Both would be one lumen, through which flow is computed as through two.

    Raises
    ------
    NetworkError
        Naming the two vessels and the place.
    """
    start, end, _, _, vessel = network.pieces()
    ends = np.sort(_piece_nodes(network, vessel)[0], axis=1)
    order = np.lexsort(ends.T)
    same = np.flatnonzero((ends[order[1:]] == ends[order[:-1]]).all(axis=1))
    if len(same):
        one, two = np.sort(order[same[0] : same[0] + 2])
        place = "({:.4g}, {:.4g}, {:.4g})".format(*((start[one] + end[one]) / 2))
        raise NetworkError(
            f"vessels {vessel[one]} and {vessel[two]} join the same nodes by the same straight "
            f"way, at {place} mm ({len(same)} such pairs): one lumen, whose flow would be counted "
            "twice; remove one of them"
        )


def _piece_nodes(network: VesselNetwork, vessel: IntArray) -> tuple[IntArray, int]:
    """Node at each end of each piece, inner polyline points counted as nodes; and how many."""
    first = np.flatnonzero(np.diff(_vessel_of_point(network)) == 0)
    inner = len(network.nodes) + np.arange(len(network.points))
    node_of_point: Any = inner
    node_of_point[network.offset[:-1]] = network.vessel_nodes[:, 0]
    node_of_point[network.offset[1:] - 1] = network.vessel_nodes[:, 1]
    ends = np.column_stack([node_of_point[first], node_of_point[first + 1]])
    return ends.astype(np.int64), len(network.nodes) + len(network.points)


def _vessel_of_point(network: VesselNetwork) -> IntArray:
    return np.repeat(np.arange(network.vessel_count), np.diff(network.offset))


def ways_between(
    pairs: NDArray[np.int64],
    limit: NDArray[np.float64],
    ends: NDArray[np.int64],
    length: NDArray[np.float64],
    nodes: int,
) -> NDArray[np.float64]:
    """Shortest way along the vessels between the nearest ends of two pieces.

    Parameters
    ----------
    pairs : (k, 2) int64
        Pieces.
    limit : (k,) float64, mm
        Ways beyond it aren't followed.
    ends : (n, 2) int64
        Nodes at the ends of each piece.
    length : (n,) float64, mm
    nodes : int
        How many there are.

    Returns
    -------
    (k,) float64, mm
        inf where there is no way within the limit.
    """
    if len(pairs) == 0:
        return np.empty(0)
    order = np.argsort(ends.ravel(), kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(ends.ravel(), minlength=nodes))])
    way: NDArray[np.float64] = _ways(pairs, limit, ends, length, first, order // 2)
    return way


@jit
def _ways(pairs: Any, limit: Any, ends: Any, length: Any, first: Any, piece: Any) -> Any:
    """Dijkstra from both ends of each first piece, bounded by the pair's limit."""
    result = np.full(len(pairs), np.inf)
    best = np.full(len(first) - 1, np.inf)
    for k in range(len(pairs)):
        one, two = pairs[k]
        heap = [(0.0, ends[one, 0]), (0.0, ends[one, 1])]
        touched = [ends[one, 0], ends[one, 1]]
        best[ends[one, 0]] = 0.0
        best[ends[one, 1]] = 0.0
        while len(heap) > 0:
            way, node = heappop(heap)
            if way > best[node]:
                continue
            if node == ends[two, 0] or node == ends[two, 1]:
                result[k] = way
                break
            for at in range(first[node], first[node + 1]):
                p = piece[at]
                other = ends[p, 0] + ends[p, 1] - node
                further = way + length[p]
                if further <= limit[k] and further < best[other]:
                    best[other] = further
                    touched.append(other)
                    heappush(heap, (further, other))
        for node in touched:
            best[node] = np.inf
    return result
