"""Merge the predicted diameters of a vessel's several strands into one diameter per vessel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import IntArray
from printctl.checks.bead.vessels import VesselDiameters


def merge_bundles(diameters: VesselDiameters, owner: IntArray) -> VesselDiameters:
    """Strands as the vessels that they make up: areas add, the worst strand speaks for all.

    Parameters
    ----------
    diameters : VesselDiameters
        Of strands.
    owner : (s,) int64
        The vessel of each strand.
    """
    vessels, group = np.unique(owner[diameters.vessel], return_inverse=True)
    of = [np.flatnonzero(group == k) for k in range(len(vessels))]
    worst = np.array([rows[np.abs(diameters.worst[rows]).argmax()] for rows in of], dtype=np.int64)

    def equal(diameter: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.sqrt(np.bincount(group, diameter**2, len(vessels)))

    written = np.asarray(np.bincount(group, diameters.written_mm, len(vessels)), dtype=np.float64)

    def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        weighted = np.bincount(group, values * diameters.written_mm, len(vessels))
        return np.asarray(weighted / written)

    return VesselDiameters(
        vessel=vessels,
        written_mm=written,
        designed_mm=equal(diameters.designed_mm),
        predicted_mm=equal(diameters.predicted_mm),
        median=mean(diameters.median),
        worst=diameters.worst[worst],
        worst_at_mm=diameters.worst_at_mm[worst],
        worst_line=diameters.worst_line[worst],
        within=mean(diameters.within),
        piece_mm=diameters.piece_mm,
    )
