"""Compare flow and territory demand at the artery ends (or outlets) of any network."""

from __future__ import annotations

import numpy as np

from design.network import VesselKind, VesselNetwork
from design.tissue import Tissue
from design.vasculature.growth.territories import SupplyBalance, supply_balance
from kernels.arrays import FloatArray, IntArray


def measure_territories(
    network: VesselNetwork, tissue: Tissue, flow: FloatArray, seed: int
) -> SupplyBalance | None:
    """Compare each terminal's flow with its territory's demand.

    Terminals are the nodes where arteries end, whatever goes on from there; in a network without
    arteries its outlets. None with fewer than two, or without flow.

    Parameters
    ----------
    flow : (v,) float64, µL/s
        In each vessel.
    """
    arteries = network.kind == VesselKind.ARTERY
    tips = _ends_of(network, arteries) if arteries.any() else network.outlets()
    into = np.bincount(
        network.vessel_nodes[:, 1], np.maximum(flow, 0.0), minlength=len(network.nodes)
    )
    supplied = np.asarray(into[tips], dtype=np.float64)
    if len(tips) < 2 or not supplied.sum() > 0.0:
        return None
    return supply_balance(tissue, network.nodes[tips], supplied, seed)


def _ends_of(network: VesselNetwork, which: np.ndarray) -> IntArray:
    """Nodes that vessels of a kind enter and none of them leave."""
    first, last = network.vessel_nodes[which].T
    return np.setdiff1d(last, first)
