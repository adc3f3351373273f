"""Slow oracles for network measures."""

import numpy as np

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from tests.design.networks import network


def wall_distances(network: VesselNetwork, points: FloatArray) -> FloatArray:
    """Distance of each point from the nearest of all spheres along every piece.

    Along a piece it is convex, so that the nearest of 101 spheres has the least within one step;
    there the next 101 are taken, four times.
    """
    start, end, ra, rb, _ = network.pieces()
    best = np.full(len(points), np.inf)
    for a, b, r0, r1 in zip(start, end, ra, rb, strict=True):
        middle, reach = np.full((len(points), 1), 0.5), 0.5
        for _ in range(4):
            t = np.clip(middle + np.linspace(-reach, reach, 101), 0.0, 1.0)
            centre = a + t[:, :, None] * (b - a)
            away = np.linalg.norm(points[:, None] - centre, axis=2) - (r0 + t * (r1 - r0))
            nearest = away.argmin(axis=1)[:, None]
            middle, reach = np.take_along_axis(t, nearest, axis=1), reach / 50
        best = np.minimum(best, np.take_along_axis(away, nearest, axis=1)[:, 0])
    return best


def random_tree(random: np.random.Generator, vessels: int) -> tuple[list[int], FloatArray]:
    """Parents (-1 for the root) and a position for each vessel's far end."""
    parents = [-1] + [int(random.integers(0, i)) for i in range(1, vessels)]
    return parents, random.uniform(0.0, 10.0, (vessels + 1, 3))


def tree_network(
    parents: list[int], nodes: FloatArray, radius: FloatArray, kind: int = 0
) -> VesselNetwork:
    """Vessel i runs from its parent's far end (node parent + 1) to node i + 1."""
    ends = np.array([[p + 1, i + 1] for i, p in enumerate(parents)])
    if kind == 1:
        ends = ends[:, ::-1]
    return network(nodes, ends, radius, kind)


def strahler(parents: list[int], i: int) -> int:
    """Strahler's order of vessel ``i`` by its definition."""
    children = [strahler(parents, j) for j, p in enumerate(parents) if p == i]
    if not children:
        return 1
    top = max(children)
    return top + (children.count(top) > 1)
