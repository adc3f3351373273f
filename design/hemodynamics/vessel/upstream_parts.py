"""Cut each probed vessel off at its flow probe; return its upstream part."""

from __future__ import annotations

import numpy as np

from design.hemodynamics.probes import Probes
from design.network import VesselNetwork
from kernels.arrays import FloatArray


def heads_of(network: VesselNetwork, probes: Probes) -> VesselNetwork:
    """Upstream part of each probe's vessel, as a network of p unjoined vessels.

    A head of no length is left where a probe stands on a vessel's first node.
    """
    parts = [
        _head(*network.polyline(int(vessel)), float(fraction))
        for vessel, fraction in zip(probes.vessel, probes.fraction, strict=True)
    ]
    counts = np.array([len(radius) for _, radius in parts])
    ends = np.arange(2 * len(parts)).reshape(-1, 2)
    return VesselNetwork(
        nodes=np.concatenate([points[[0, -1]] for points, _ in parts]),
        vessel_nodes=ends,
        kind=network.kind[probes.vessel],
        tree=network.tree[probes.vessel],
        offset=np.concatenate([[0], np.cumsum(counts)]),
        points=np.concatenate([points for points, _ in parts]),
        radius=np.concatenate([radius for _, radius in parts]),
    )


def _head(points: FloatArray, radius: FloatArray, fraction: float) -> tuple[FloatArray, FloatArray]:
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    where = fraction * along[-1]
    # The piece that the probe stands in: all before it are whole.
    piece = min(max(int(np.searchsorted(along, where)) - 1, 0), len(steps) - 1)
    share = (where - along[piece]) / steps[piece] if steps[piece] > 0.0 else 0.0
    last = points[piece] + share * (points[piece + 1] - points[piece])
    thick = radius[piece] + share * (radius[piece + 1] - radius[piece])
    return np.vstack([points[: piece + 1], last]), np.append(radius[: piece + 1], thick)
