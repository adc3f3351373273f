"""Cut vessel ends that stick out of a tissue off at its surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from design.network import VesselNetwork
from design.tissue import Tissue
from kernels.arrays import FloatArray

AT_SURFACE_MM: Final = 1e-3
"""Ends that stick out less are on the surface."""
HALVINGS: Final = 40


@dataclass(frozen=True)
class CutEnd:
    """A vessel's free end that stuck out.

    Attributes
    ----------
    vessel : int
    length_mm : float
        Cut off.
    at_mm : (3,) float64
        Where the vessel ends now: on the surface.
    """

    vessel: int
    length_mm: float
    at_mm: FloatArray


def clip_ends(tissue: Tissue, network: VesselNetwork) -> tuple[VesselNetwork, tuple[CutEnd, ...]]:
    """Cut free ends off where their vessel leaves the tissue for good.

    A vessel that lies outside altogether, and one that leaves the tissue between its ends, stay as
    they are.

    Returns
    -------
    network : VesselNetwork
        The same object where nothing sticks out.
    cut : tuple of CutEnd
    """
    nodes = network.nodes.copy()
    lines = list(network.polylines())
    free = network.degree() == 1
    out = free & (tissue.grid.distance(network.nodes) > AT_SURFACE_MM)
    cut: list[CutEnd] = []
    for vessel, side in zip(*np.nonzero(out[network.vessel_nodes]), strict=True):
        points, radius = (line[:: -1 if side else 1] for line in lines[vessel])
        found = _cut(tissue, points, radius)
        if found is None:
            continue
        points, radius, length = found
        nodes[network.vessel_nodes[vessel, side]] = points[0]
        lines[vessel] = points[:: -1 if side else 1], radius[:: -1 if side else 1]
        cut.append(CutEnd(int(vessel), length, points[0]))
    if not cut:
        return network, ()
    clipped = VesselNetwork(
        nodes=nodes,
        vessel_nodes=network.vessel_nodes,
        kind=network.kind,
        tree=network.tree,
        offset=np.cumsum([0] + [len(points) for points, _ in lines]),
        points=np.concatenate([points for points, _ in lines]),
        radius=np.concatenate([radius for _, radius in lines]),
    )
    return clipped, tuple(cut)


def _cut(
    tissue: Tissue, points: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray, float] | None:
    """A polyline from where it enters the tissue on, and the length before; None if it doesn't."""
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    step = 0.25 * tissue.grid.spacing_mm
    samples = np.union1d(np.arange(0.0, along[-1], step), along)

    def at(length: float | FloatArray) -> FloatArray:
        return np.stack([np.interp(length, along, points[:, axis]) for axis in range(3)], axis=-1)

    inside = np.flatnonzero(tissue.grid.distance(at(samples)) < 0.0)
    if not len(inside) or inside[0] == 0:
        return None
    low, high = float(samples[inside[0] - 1]), float(samples[inside[0]])
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if tissue.grid.distance(at(np.array([middle])))[0] < 0.0:
            high = middle
        else:
            low = middle
    kept = along > high + AT_SURFACE_MM
    if not kept.any():
        return None
    width = float(np.interp(low, along, radius))
    return np.vstack([at(low), points[kept]]), np.append(width, radius[kept]), low
