"""Slow checker of the needle's shaft, from moves and network alone.

What is written is kept as balls on a fine sampling; of every place of the tip all of them are
looked at. Touching is meant within a joint: where ink is near the tip along the network, or both
are near one fork. Vessels that overlap elsewhere are one body there, as at a fork.
"""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from design.network import VesselNetwork
from design.toolpath import MoveKind, Toolpath

OVERLAP = 1.0
"""Joints overlap by no more than so many radii."""
SLACK_MM = 0.1


class Way(NamedTuple):
    """Points along all vessels, ways between them along the network, and which are forks."""

    point: np.ndarray
    vessel: np.ndarray
    arc: np.ndarray
    forks: np.ndarray


def crossings(
    toolpath: Toolpath, network: VesselNetwork, shaft_mm: float, spacing_mm: float = 0.05
) -> set[tuple[int, int]]:
    """Pairs (vessel being written, left or entered; vessel written before) that the shaft meets."""
    way = sampled(network, shaft_mm, spacing_mm)
    ink: list[tuple[np.ndarray, float, int, int]] = []
    found: set[tuple[int, int]] = set()
    for move in range(len(toolpath)):
        start, end = toolpath.start[move], toolpath.end[move]
        length = float(np.linalg.norm(end - start))
        if length == 0:
            continue
        tips = np.linspace(start, end, int(np.ceil(length / spacing_mm)) + 1)
        vessel, anchor = _anchor(toolpath, move)
        radius = float(np.sqrt(toolpath.volume_ul[move] / length / np.pi))
        if ink:
            found |= _hits(tips, vessel, anchor, radius, ink, way, shaft_mm, network)
        if toolpath.kind[move] == MoveKind.WRITE:
            ink += [(tip, radius, vessel, _nearest(way, tip, vessel)) for tip in tips]
    return found


def joint_mm(shaft_mm, radius):
    """How far a joint reaches along the network."""
    return np.sqrt(2) * (shaft_mm + radius) + OVERLAP * radius + SLACK_MM


def sampled(network: VesselNetwork, shaft_mm: float, spacing_mm: float) -> Way:
    point, vessel, radius, edges = [*network.nodes], [-1] * len(network.nodes), [], []
    radius = [0.0] * len(network.nodes)
    for number, (tail, head) in enumerate(network.vessel_nodes.tolist()):
        line, thick = network.polyline(number)
        last = tail
        for k in range(len(line) - 1):
            count = int(np.ceil(np.linalg.norm(line[k + 1] - line[k]) / spacing_mm))
            for t in np.arange(1, count + 1) / max(count, 1):
                end = k == len(line) - 2 and t == 1
                here = head if end else len(point)
                if not end:
                    point.append(line[k] + t * (line[k + 1] - line[k]))
                    vessel.append(number)
                    radius.append(thick[k] + t * (thick[k + 1] - thick[k]))
                edges.append((last, here))
                last = here
    point, vessel, radius = np.array(point), np.array(vessel), np.array(radius)
    edges = np.array(edges)
    forks = np.bincount(edges.ravel(), minlength=len(point)) > 2
    arc = _ways(point, edges)
    pairs = KDTree(point).query_pairs(2 * radius.max(), output_type="ndarray")
    a, b = pairs.T
    thick = radius[a] + radius[b]
    touch = (np.linalg.norm(point[a] - point[b], axis=1) < thick) & (
        arc[a, b] > joint_mm(shaft_mm, np.maximum(radius[a], radius[b]))
    )
    touch &= (radius[a] > 0) & (radius[b] > 0)
    if touch.any():
        forks[pairs[touch].ravel()] = True
        arc = _ways(point, np.vstack([edges, pairs[touch]]))
    return Way(point, vessel, arc, np.flatnonzero(forks))


def _ways(point, edges):
    length = np.linalg.norm(point[edges[:, 0]] - point[edges[:, 1]], axis=1)
    graph = coo_array((length, tuple(edges.T)), shape=(len(point), len(point))).tocsr()
    return dijkstra(graph, directed=False, limit=3.0)


def _nearest(way: Way, place: np.ndarray, vessel: int) -> int:
    own = np.flatnonzero((way.vessel == vessel) | (way.vessel == -1))
    return int(own[np.argmin(np.linalg.norm(way.point[own] - place, axis=1))])


def _anchor(toolpath: Toolpath, move: int) -> tuple[int, np.ndarray | None]:
    """Vessel of a move and, of a lift, the place in the joint that it leaves or goes to.

    None for a move that writes, whose tips are such places themselves, and far away for a travel.
    """
    if toolpath.kind[move] == MoveKind.WRITE:
        return int(toolpath.source[move]), None
    write = toolpath.kind == MoveKind.WRITE
    before, after = np.flatnonzero(write[:move]), np.flatnonzero(write[move:]) + move
    upright = np.array_equal(toolpath.start[move, :2], toolpath.end[move, :2])
    if upright and len(before):
        left = toolpath.end[before[-1]]
        if np.array_equal(left[:2], toolpath.end[move, :2]):
            return int(toolpath.source[before[-1]]), left
    vessel = int(toolpath.source[after[0] if len(after) else before[-1]])
    if upright and len(after):
        return vessel, toolpath.start[after[0]]
    return vessel, np.full(3, np.inf)


def _hits(tips, vessel, anchor, radius, ink, way, shaft_mm, network):
    place = np.array([point for point, _, _, _ in ink])
    thick = np.array([r for _, r, _, _ in ink])
    owner = np.array([v for _, _, v, _ in ink])
    sample = np.array([s for _, _, _, s in ink])
    # A travel has no radius of its own; the joint it leaves or enters is the vessel's.
    radius = radius or float(network.polyline(vessel)[1].max())
    found = set()
    for tip in tips:
        across = np.hypot(*(place[:, :2] - tip[:2]).T)
        gap = np.hypot(np.maximum(across - shaft_mm, 0), np.maximum(tip[2] - place[:, 2], 0))
        hit = np.flatnonzero(gap < thick)
        if not len(hit):
            continue
        if anchor is None or np.isfinite(anchor).all():
            here = _nearest(way, tip if anchor is None else anchor, vessel)
            reach = joint_mm(shaft_mm, np.maximum(thick[hit], radius))
            spared = way.arc[here, sample[hit]] <= reach
            forks = way.arc[way.forks]
            both = np.maximum(forks[:, [here]], forks[:, sample[hit]]) <= reach
            hit = hit[~(spared | both.any(axis=0))]
        found |= {(vessel, int(v)) for v in owner[hit]}
    return found
