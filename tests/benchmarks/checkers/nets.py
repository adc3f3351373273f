"""Small test networks with known checker results."""

import numpy as np

from benchmarks.checkers import Pieces, pieces_of


def net_of(points, edges, radius) -> Pieces:
    """Straight pieces between numbered points."""
    points, edges = np.array(points, dtype=float), np.array(edges)
    radius = np.broadcast_to(radius, len(edges)) if np.ndim(radius) < 2 else np.array(radius)
    return pieces_of(points[edges[:, 0]], points[edges[:, 1]], radius, edges)


def fork(radius=0.1) -> Pieces:
    """A root along x and two branches, in the plane z = 0."""
    points = [[0, 0, 0], [2, 0, 0], [4, 2, 0], [4, -2, 0]]
    return net_of(points, [[0, 1], [1, 2], [1, 3]], radius)


def random_tree(random: np.random.Generator, terminals: int, radius=0.01) -> Pieces:
    """A binary tree: each new point forks a random piece at its middle."""
    points = [np.zeros(3), random.uniform(size=3)]
    edges = [[0, 1]]
    for _ in range(terminals - 1):
        k = random.integers(len(edges))
        start, end = edges[k]
        points += [(points[start] + points[end]) / 2, random.uniform(size=3)]
        fork_at, tip = len(points) - 2, len(points) - 1
        edges[k] = [start, fork_at]
        edges += [[fork_at, end], [fork_at, tip]]
    return net_of(points, edges, radius)
