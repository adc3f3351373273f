"""Merge the predicted diameters of a vessel's several strands into one diameter per vessel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import IntArray
from printctl.bead.vessels import VesselDiameters


def merge_bundles(found: VesselDiameters, owner: IntArray) -> VesselDiameters:
    """Strands as the vessels that they make up: areas add, the worst strand speaks for all.

    Parameters
    ----------
    found : VesselDiameters
        Of strands.
    owner : (s,) int64
        The vessel of each strand.
    """
    vessels, group = np.unique(owner[found.vessel], return_inverse=True)
    of = [np.flatnonzero(group == k) for k in range(len(vessels))]
    worst = np.array([rows[np.abs(found.worst[rows]).argmax()] for rows in of], dtype=np.int64)

    def equal(diameter: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.sqrt(np.bincount(group, diameter**2, len(vessels)))

    written = np.asarray(np.bincount(group, found.written_mm, len(vessels)), dtype=np.float64)

    def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        weighted = np.bincount(group, values * found.written_mm, len(vessels))
        return np.asarray(weighted / written)

    return VesselDiameters(
        vessel=vessels,
        written_mm=written,
        designed_mm=equal(found.designed_mm),
        predicted_mm=equal(found.predicted_mm),
        median=mean(found.median),
        worst=found.worst[worst],
        worst_at_mm=found.worst_at_mm[worst],
        worst_line=found.worst_line[worst],
        within=mean(found.within),
        piece_mm=found.piece_mm,
    )
