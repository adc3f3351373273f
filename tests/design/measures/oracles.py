"""Slow oracles for network measures."""

import numpy as np

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from tests.design.networks import network


def wall_distances(network: VesselNetwork, points: FloatArray, steps: int = 2001) -> FloatArray:
    """Distance of each point from the nearest of many spheres along every piece."""
    t = np.linspace(0.0, 1.0, steps)[:, None]
    start, end, ra, rb, _ = network.pieces()
    best = np.full(len(points), np.inf)
    for a, b, r0, r1 in zip(start, end, ra, rb, strict=True):
        centre, radius = a + t * (b - a), r0 + t[:, 0] * (r1 - r0)
        away = np.linalg.norm(points[:, None] - centre[None], axis=2) - radius
        best = np.minimum(best, away.min(axis=1))
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
