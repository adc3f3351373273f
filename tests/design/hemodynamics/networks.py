"""Small handmade networks for flow tests."""

from functools import partial

import numpy as np

from design.network import VesselKind, VesselNetwork
from tests.design.networks import network

VISCOSITY = 4e-3


network_of = partial(network, kind=VesselKind.CHANNEL)
"""Straight channels of constant radius."""


def random_tree(seed: int, vessels: int, spread: float = 1.0) -> VesselNetwork:
    """A tree whose radii span e^±spread; vessels leave their parent's far node."""
    rng = np.random.default_rng(seed)
    parent = [int(rng.integers(0, k)) if k > 1 else 0 for k in range(1, vessels + 1)]
    if vessels > 1:
        parent[1:] = [max(1, node) for node in parent[1:]]
    return network_of(
        rng.normal(size=(vessels + 1, 3)),
        [(parent[k], k + 1) for k in range(vessels)],
        np.exp(spread * rng.normal(size=vessels)),
    )
