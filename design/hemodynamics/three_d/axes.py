"""Place points along vessel centrelines, a multiple of the local radius apart, for meshing."""

from __future__ import annotations

import numpy as np

from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray


def axis_places(network: VesselNetwork, ratio: float) -> tuple[FloatArray, FloatArray, IntArray]:
    """Places along the axes, ``ratio`` radii apart; that distance at each, mm; its vessel."""
    start, end, r0, r1, vessel = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    count = np.ceil(length / (ratio * np.minimum(r0, r1))).astype(np.int64)
    piece = np.repeat(np.arange(len(start)), count)
    step = np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)
    t = ((step + 0.5) / count[piece])[:, None]
    radius = (1.0 - t[:, 0]) * r0[piece] + t[:, 0] * r1[piece]
    return (1.0 - t) * start[piece] + t * end[piece], ratio * radius, vessel[piece]
