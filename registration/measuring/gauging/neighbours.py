"""Share of a vessel's designed wall at each cross-section that lies in no other lumen."""

from __future__ import annotations

import numpy as np

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.measuring.gauging.planes import across_tangents

_ANGLES = 2 * np.pi * np.arange(16) / 16


class Neighbours:
    """The lumens around each vessel of a network."""

    def __init__(self, network: VesselNetwork) -> None:
        self._network = network
        start, end, r0, r1, vessel = network.pieces()
        self._start, self._way, self._r0, self._dr = start, end - start, r0, r1 - r0
        self._vessel = vessel
        self._at_node: dict[int, set[int]] = {}
        for index, ends in enumerate(network.vessel_nodes.tolist()):
            for node in ends:
                self._at_node.setdefault(node, set()).add(index)

    def free_wall(
        self, vessel: int, centre: FloatArray, tangent: FloatArray, radius: FloatArray
    ) -> FloatArray:
        """Share of the designed wall around each station that no neighbour's lumen holds.

        Parameters
        ----------
        vessel : int
        centre, tangent : (n, 3)
            Stations along it, mm.
        radius : (n,) mm
            Designed.

        Returns
        -------
        (n,) float64, 0 to 1
        """
        pieces = np.flatnonzero(np.isin(self._vessel, sorted(self._around(vessel))))
        if len(pieces) == 0:
            return np.ones(len(centre))
        wall = _rings(centre, tangent, radius)
        way = self._way[pieces]
        off = wall[:, :, None] - self._start[pieces]
        along = np.einsum("srpk,pk->srp", off, way) / np.einsum("pk,pk->p", way, way)
        along = np.clip(along, 0.0, 1.0)
        away = np.linalg.norm(off - along[..., None] * way, axis=-1)
        inside = (away < self._r0[pieces] + along * self._dr[pieces]).any(axis=-1)
        return 1.0 - np.asarray(inside.mean(axis=1))

    def _around(self, vessel: int) -> set[int]:
        """Vessels that meet ``vessel``, and those that meet them: a short one doesn't part two."""
        near = self._meeting(vessel)
        return set().union(near, *(self._meeting(other) for other in near)) - {vessel}

    def _meeting(self, vessel: int) -> set[int]:
        first, last = self._network.vessel_nodes[vessel].tolist()
        return self._at_node[first] | self._at_node[last]


def _rings(centre: FloatArray, tangent: FloatArray, radius: FloatArray) -> FloatArray:
    """Points (n, 16, 3) on circles across the tangents."""
    across = across_tangents(tangent)
    circle = np.cos(_ANGLES)[:, None] * across[:, :1] + np.sin(_ANGLES)[:, None] * across[:, 1:]
    return np.asarray(centre[:, None] + radius[:, None, None] * circle)
