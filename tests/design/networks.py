"""Test networks: straight vessels, polylines, random graphs and trees."""

from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import strategies as st

from design.network import VesselKind, VesselNetwork

TOWARDS_ROOT = (int(VesselKind.VEIN), int(VesselKind.LYMPH))


def network(
    nodes: Any, ends: Any, radius: Any, kind: Any = VesselKind.ARTERY, tree: Any = 0
) -> VesselNetwork:
    """Straight vessels between nodes (n, 3), mm; radius, kind and tree of all or of each."""
    radii = np.full(len(ends), radius, dtype=float)
    of_each = [np.full(len(ends), one, dtype=np.int64) for one in (kind, tree)]
    return VesselNetwork.from_segments(np.array(nodes, float), np.array(ends), radii, *of_each)


def polylines(lines: Any, radius: Any, kind: Any = VesselKind.ARTERY) -> VesselNetwork:
    """A vessel along each line; equal ends are one node. Radius, mm, of all or of each point."""
    ends = np.array([line[k] for line in lines for k in (0, -1)], dtype=float)
    nodes, number = np.unique(ends, axis=0, return_inverse=True)
    points = np.concatenate(lines).astype(float)
    return VesselNetwork(
        nodes=nodes,
        vessel_nodes=number.reshape(-1, 2),
        kind=np.full(len(lines), kind, dtype=np.int64),
        tree=np.zeros(len(lines), dtype=np.int64),
        offset=np.cumsum([0, *map(len, lines)]),
        points=points,
        radius=np.full(len(points), radius, dtype=float),
    )


def polyline(points: Any, radius: Any) -> VesselNetwork:
    """One vessel from its first point to its last."""
    made = polylines([np.asarray(points, float)], radius)
    return replace(made, nodes=made.points[[0, -1]], vessel_nodes=np.array([[0, 1]]))


def random_network(seed: int, vessels: int) -> VesselNetwork:
    """Any graph: loops, parallel vessels, tapers, inner points."""
    random = np.random.default_rng(seed)
    nodes = random.normal(0.0, 10.0, (vessels + 1, 3))
    first = random.integers(0, vessels + 1, vessels)
    last = (first + random.integers(1, vessels + 1, vessels)) % (vessels + 1)
    return with_points(
        random,
        nodes,
        np.column_stack([first, last]),
        random.integers(0, 5, vessels),
        random.integers(0, 3, vessels),
    )


def random_trees(seed: int, vessels: int, roots: int) -> VesselNetwork:
    """Trees, each of one kind; every node below a root has one vessel on the root's side."""
    random = np.random.default_rng(seed)
    nodes = random.normal(0.0, 10.0, (roots + vessels, 3))
    tree = np.arange(roots + vessels)
    ends = []
    for i in range(vessels):
        parent = i if i < roots else int(random.integers(0, roots + i))
        tree[roots + i] = tree[parent]
        ends.append((parent, roots + i))
    kind = random.integers(0, 5, roots)[tree[roots:]]
    back = np.isin(kind, TOWARDS_ROOT)
    both = np.array(ends)
    both[back] = both[back, ::-1]
    # Each root has a vessel only if there are at least as many vessels.
    return with_points(random, nodes, both, kind, tree[roots:])


def with_points(
    random: np.random.Generator, nodes: object, ends: object, kind: object, tree: object
) -> VesselNetwork:
    """Give each vessel up to three inner points, and radii that jump at some nodes."""
    place, joins = np.asarray(nodes, dtype=float), np.asarray(ends, dtype=np.int64)
    points, offset = [], [0]
    for first, last in joins:
        inner = random.normal(0.0, 10.0, (int(random.integers(0, 4)), 3))
        points.append(np.concatenate([place[[first]], inner, place[[last]]]))
        offset.append(offset[-1] + len(points[-1]))
    flat = np.concatenate(points)
    return VesselNetwork(
        place,
        joins,
        np.asarray(kind, dtype=np.int64),
        np.asarray(tree, dtype=np.int64),
        np.array(offset),
        flat,
        random.choice([0.1, 0.25, 1 / 3, 0.7], len(flat)),
    )


networks = st.builds(random_network, st.integers(0, 2**32), st.integers(1, 12))
trees = st.integers(1, 3).flatmap(
    lambda roots: st.builds(
        random_trees, st.integers(0, 2**32), st.integers(roots, 15), st.just(roots)
    )
)
