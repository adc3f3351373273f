"""Test networks and bodies for solids."""

from functools import partial

import numpy as np

from design.network import VesselKind, VesselNetwork
from tests.design.networks import network, polyline

channels = partial(network, kind=VesselKind.CHANNEL)
"""Straight channels of constant radius between nodes."""

vessel = polyline
"""One vessel along points."""


def ladder() -> VesselNetwork:
    """Inlet, header, four channels of different width, header, outlet, all at z = 1.5 mm."""
    rungs = [1.4, 3.2, 5.0, 6.8]
    plan = [(0, 4.1), (3, 4.1), *((3, y) for y in rungs), *((13, y) for y in rungs)]
    plan += [(13, 4.1), (16, 4.1)]
    ends = [(0, 1), (1, 3), (3, 2), (1, 4), (4, 5)]
    ends += [(2 + rung, 6 + rung) for rung in range(4)]
    ends += [(6, 7), (7, 10), (9, 8), (8, 10), (10, 11)]
    radius = [0.5] * 5 + [0.2, 0.25, 0.3, 0.4] + [0.5] * 5
    return channels([(x, y, 1.5) for x, y in plan], ends, radius)


def lattice(
    size: int, pitch: float, radius: float, turn: np.ndarray | None = None
) -> VesselNetwork:
    """Cubic lattice of ``size``³ nodes, turned by the matrix ``turn``."""
    index = np.arange(size**3).reshape(size, size, size)
    nodes = pitch * np.stack(np.unravel_index(index.ravel(), index.shape), axis=1).astype(float)
    ends = [
        np.stack(
            [np.moveaxis(index, axis, 0)[:-1].ravel(), np.moveaxis(index, axis, 0)[1:].ravel()]
        )
        for axis in range(3)
    ]
    return channels(nodes if turn is None else nodes @ turn.T, np.hstack(ends).T, radius)
