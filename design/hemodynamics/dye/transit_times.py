"""Compute each vessel's transit time in steady flow; sort vessels in downstream order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics.vessel.geometry import integral_of_power
from design.hemodynamics.zero_d.flow import FlowSolution
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray

STILL = 1e-9
"""µL/s of 1 µL/s into the network, below which nothing flows."""


@dataclass(frozen=True)
class CarryingFlow:
    """The steady flow that carries dye, at 1 µL/s into the network.

    Attributes
    ----------
    solution : FlowSolution
    volume : (v,) float64, µL
    transit_s : (v,) float64, s
        Volume over flow; inf where nothing flows.
    earliest_s : (m,) float64, s
        Least sum of mean transits from an inlet to each node; inf where none leads.
    """

    solution: FlowSolution
    volume: FloatArray
    transit_s: FloatArray
    earliest_s: FloatArray

    def moves(self) -> NDArray[np.bool_]:
        """Vessels that carry flow, (v,)."""
        return np.isfinite(self.transit_s)


def steady_transit(
    network: VesselNetwork, solution: FlowSolution, inlets: tuple[int, ...]
) -> CarryingFlow:
    """Transits of a flow of 1 µL/s that dye enters at ``inlets``."""
    volume = np.pi * integral_of_power(network, 2)
    flow = np.abs(solution.flow)
    transit = np.where(flow > STILL, volume / np.maximum(flow, STILL), np.inf)
    earliest: FloatArray = np.full(len(network.nodes), np.inf)
    earliest[list(inlets)] = 0.0
    for k in downstream_order(network, solution):
        first, last = flow_ends(network, solution, int(k))
        earliest[last] = min(earliest[last], earliest[first] + transit[k])
    return CarryingFlow(solution, volume, transit, earliest)


def downstream_order(network: VesselNetwork, solution: FlowSolution) -> IntArray:
    """Vessels that flow, by falling pressure at their beginning."""
    begins = solution.pressure[network.vessel_nodes].max(axis=1)
    order = np.argsort(-begins, kind="stable")
    return np.asarray(order[np.abs(solution.flow[order]) > STILL])


def flow_ends(network: VesselNetwork, solution: FlowSolution, vessel: int) -> tuple[int, int]:
    """Nodes a vessel's flow runs from and to."""
    first, last = network.vessel_nodes[vessel].tolist()
    return (first, last) if solution.flow[vessel] >= 0.0 else (last, first)
