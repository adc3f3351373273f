"""Generate networks for the flow benchmarks, without the product's growth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from design.network import FloatArray, IntArray, VesselNetwork


def binary_tree(terminals: int, seed: int = 0) -> VesselNetwork:
    """An even binary tree by Murray's law, its nodes anywhere in a cube of 50 mm."""
    count = 2 * terminals - 1
    rng = np.random.default_rng(seed)
    number = np.arange(1, count)
    first = np.concatenate([[0], (number - 1) // 2 + 1])
    depth = np.floor(np.log2(np.arange(1, count + 1)))
    radius = 2.0 * 2.0 ** (-depth / 3.0) * np.exp(0.05 * rng.normal(size=count))
    ends = np.column_stack([first, np.arange(1, count + 1)])
    return _network(50.0 * rng.random((count + 1, 3)), ends, radius)


def joined_trees(terminals: int, seed: int = 0) -> VesselNetwork:
    """An artery and a vein that halve the same points along different axes, joined at each.

    As many loops as terminals less one, two to three times the vessels of a tree.
    """
    rng = np.random.default_rng(seed)
    points = rng.random((terminals, 3))
    artery, tips, nodes = _halving(points, 0)
    vein, others, more = _halving(points, 1)
    joints = np.column_stack([tips, others + nodes])
    ends = np.concatenate([artery, vein[:, ::-1] + nodes, joints])
    radius = np.exp(0.5 * rng.normal(size=len(ends)))
    return _network(50.0 * rng.random((nodes + more, 3)), ends, radius)


def crossed_tree(terminals: int, loops: int, seed: int = 0) -> VesselNetwork:
    """`binary_tree` with cross connections between nodes of neighbouring numbers."""
    tree = binary_tree(terminals, seed)
    rng = np.random.default_rng(seed + 1)
    inner = rng.choice(np.arange(2, terminals - 2), loops, replace=False)
    cross = np.column_stack([inner, inner + 1])
    ends = np.concatenate([tree.vessel_nodes, cross])
    radius = np.concatenate([tree.radius[::2], np.full(loops, 0.05)])
    return _network(tree.nodes, ends, radius)


def tapered(network: VesselNetwork) -> VesselNetwork:
    """The same with every vessel a fifth narrower at its end."""
    radius = network.radius.copy()
    radius[network.offset[1:] - 1] *= 0.8
    return replace(network, radius=radius)


def _halving(points: FloatArray, axis: int) -> tuple[IntArray, IntArray, int]:
    """Vessels of a tree over points, each point's tip, and how many nodes; the root is 0."""
    order, tip = np.arange(len(points)), np.empty(len(points), dtype=np.int64)
    ends, stack, nodes = [(0, 1)], [(0, len(points), 1, axis)], 2
    while stack:
        low, high, node, along = stack.pop()
        if high - low == 1:
            tip[order[low]] = node
            continue
        middle = (low + high) // 2
        part = order[low:high]
        part[:] = part[np.argpartition(points[part, along], middle - low)]
        for begin, end in ((low, middle), (middle, high)):
            ends.append((node, nodes))
            stack.append((begin, end, nodes, (along + 1) % 3))
            nodes += 1
    return np.array(ends), tip, nodes


def _network(nodes: FloatArray, ends: IntArray, radius: FloatArray) -> VesselNetwork:
    kind = np.zeros(len(ends), dtype=np.int64)
    return VesselNetwork.from_segments(nodes, ends, radius, kind, kind)
