"""Small handmade networks for flow tests."""

from __future__ import annotations

import numpy as np

from design.network import VesselNetwork

VISCOSITY = 4e-3


def network_of(
    nodes: list[list[float]], ends: list[tuple[int, int]], radius: list[float] | float
) -> VesselNetwork:
    """Straight channels of constant radius."""
    return VesselNetwork.from_segments(
        np.array(nodes, dtype=float),
        np.array(ends),
        np.broadcast_to(np.asarray(radius, dtype=float), (len(ends),)),
        np.full(len(ends), 4),
        np.zeros(len(ends), dtype=np.int64),
    )


def random_tree(seed: int, vessels: int, spread: float = 1.0) -> VesselNetwork:
    """A tree whose radii span e^±spread; vessels leave their parent's far node."""
    rng = np.random.default_rng(seed)
    parent = [int(rng.integers(0, k)) if k > 1 else 0 for k in range(1, vessels + 1)]
    if vessels > 1:
        parent[1:] = [max(1, node) for node in parent[1:]]
    return network_of(
        rng.normal(size=(vessels + 1, 3)).tolist(),
        [(parent[k], k + 1) for k in range(vessels)],
        np.exp(spread * rng.normal(size=vessels)).tolist(),
    )
