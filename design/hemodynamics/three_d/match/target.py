"""Set target flows for radius matching: the design's 0D flows, or given outlet flows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from design.errors import FlowError
from design.hemodynamics.conditions import FlowConditions
from design.hemodynamics.zero_d.steady import solve_flow
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Target:
    """Target flows of a network.

    Attributes
    ----------
    vessel : (k,) int64
    flow : (k,) float64, µL/s
        From the vessel's first node to its last.
    """

    vessel: IntArray
    flow: FloatArray


def ideal_target(network: VesselNetwork, conditions: FlowConditions) -> Target:
    """Flows of all vessels as the design is meant: 0D of its own radii.

    Raises
    ------
    FlowError
        As `solve_flow`.
    """
    return Target(np.arange(network.vessel_count), solve_flow(network, conditions).flow)


def outlet_target(
    network: VesselNetwork, conditions: FlowConditions, flows: Mapping[int, float]
) -> Target:
    """Flows wanted out of outlets, by their nodes, µL/s.

    Raises
    ------
    FlowError
        A node that isn't an outlet, a flow that isn't above 0, flows of all outlets whose sum
        isn't the inlet's.
    """
    outlets = network.outlets().tolist()
    for node, flow in flows.items():
        if node not in outlets:
            raise FlowError(f"node {node} is given a flow and isn't an outlet; those are {outlets}")
        if not (np.isfinite(flow) and flow > 0.0):
            raise FlowError(f"the flow wanted out of node {node} is {flow:g} µL/s; give above 0")
    inflow, total = conditions.inlet_flow_ul_s, sum(flows.values())
    whole = set(flows) == set(outlets)
    if inflow is not None and ((whole and abs(total / inflow - 1.0) > 1e-3) or total > inflow):
        raise FlowError(
            f"the flows wanted at outlets sum to {total:g} µL/s and the inlet has {inflow:g}; "
            "give flows that add up to it, or leave one outlet out"
        )
    vessels = [int(np.flatnonzero(network.vessel_nodes[:, 1] == node)[0]) for node in flows]
    return Target(np.array(vessels, np.int64), np.array(list(flows.values()), np.float64))
