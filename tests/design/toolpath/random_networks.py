"""Random networks of six kinds, and needles, for planner and checker tests."""

import numpy as np

from design.network import VesselNetwork
from tests.design.networks import network, polylines
from tests.design.toolpath.shapes import helix, random_tree

KINDS = ("tree", "crowded", "loop", "lattice", "helix", "bent")
NEEDLES = ((0.31, 0.31, 0.0), (0.72, 0.72, 0.0), (0.8, 0.31, 1.5))
"""Outer diameter, its tip's, and the height of the cone between, mm."""


def random_network(seed: int) -> tuple[VesselNetwork, tuple[float, float, float]]:
    """A network of the kind that the seed says, and the needle to write it with."""
    rng = np.random.default_rng(seed)
    kind, radius = KINDS[seed % len(KINDS)], float(rng.uniform(0.07, 0.25))
    needle = NEEDLES[seed // len(KINDS) % len(NEEDLES)]
    match kind:
        case "tree":
            return random_tree(int(rng.integers(2, 25)), rng.uniform(8, 16), seed, radius), needle
        case "crowded":
            return random_tree(int(rng.integers(8, 25)), rng.uniform(3, 7), seed, radius), needle
        case "bent":
            straight = random_tree(int(rng.integers(2, 16)), rng.uniform(6, 16), seed, radius)
            return _bent(straight, rng, float(rng.uniform(0.1, 0.6))), needle
        case "lattice":
            return _lattice(rng), needle
        case "helix":
            lines = [
                helix(*rng.uniform([1, 0.8, 1, 0], [3, 3, 4, 6]).tolist())
                for _ in range(int(rng.integers(1, 4)))
            ]
            return polylines(lines, radius), needle
        case _:
            tree = random_tree(int(rng.integers(2, 14)), rng.uniform(6, 14), seed, radius)
            return _mirrored(tree, rng, radius), needle


def _bent(net: VesselNetwork, rng: np.random.Generator, share: float) -> VesselNetwork:
    """Every vessel a smooth wiggle; some ends miss their nodes by rounding."""
    lines, t = [], np.linspace(0, 1, 13)
    for a, b in net.vessel_nodes.tolist():
        p, q = net.nodes[a], net.nodes[b]
        waves = sum(np.outer(np.sin(np.pi * k * t), rng.normal(size=3)) / k for k in (1, 2, 3))
        lines.append(p + t[:, None] * (q - p) + 0.3 * share * np.linalg.norm(q - p) * waves)
    return polylines(lines, float(net.radius.mean()))


def _lattice(rng: np.random.Generator) -> VesselNetwork:
    count, pitch = rng.integers(2, 4, 3), rng.uniform(0.8, 3.0)
    cells = np.argwhere(np.ones(count))
    points = pitch * (cells + 0.15 * rng.normal(size=cells.shape))
    number = {tuple(cell): k for k, cell in enumerate(cells.tolist())}
    pairs = [
        (k, number[after])
        for cell, k in number.items()
        for axis in np.eye(3, dtype=int)
        if (after := tuple((np.array(cell) + axis).tolist())) in number
    ]
    return network(points, pairs, rng.uniform(0.08, 0.25))


def _mirrored(tree: VesselNetwork, rng: np.random.Generator, radius: float) -> VesselNetwork:
    """A tree and its mirror image above, joined at their ends."""
    degree = np.bincount(tree.vessel_nodes.ravel(), minlength=len(tree.nodes))
    up = float(2 * tree.nodes[:, 2].max() + rng.uniform(0.5, 3))
    image = tree.nodes * [1, 1, -1] + [*rng.uniform(-1, 1, 2), up]
    count, pairs = len(tree.nodes), tree.vessel_nodes
    joins = [(leaf, leaf + count) for leaf in np.flatnonzero(degree == 1).tolist()]
    return network(
        np.vstack([tree.nodes, image]), [*pairs.tolist(), *(pairs + count).tolist(), *joins], radius
    )
