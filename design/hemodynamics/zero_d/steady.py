"""Steady 0D flow in any graph of vessels."""

from __future__ import annotations

import numpy as np

from design.hemodynamics.conditions import FlowConditions
from design.hemodynamics.vessel.geometry import integrals
from design.hemodynamics.vessel.resistance import resistance_of
from design.hemodynamics.zero_d.boundary import Boundary, place_conditions
from design.hemodynamics.zero_d.flow import FlowSolution
from design.hemodynamics.zero_d.nodal.conductance import factorise
from design.network import FloatArray, IntArray, VesselNetwork


def solve_flow(network: VesselNetwork, conditions: FlowConditions) -> FlowSolution:
    """Solve Poiseuille flow, Q = (p₀ - p₁)/R in each vessel and Σ Q = 0 at each inner node.

    Loops, tapers, several inlets and several parts are allowed. Inlets fed by a flow share one
    pressure. Branches are eliminated in linear time, what loops remain by sparse factorisation.
    Mass is conserved to rounding, relative to the flow through each node, however small the
    pressure differences are beside the pressures: what a solution leaves over at the nodes is
    solved for again and added to the flows themselves.

    Parameters
    ----------
    network : VesselNetwork
    conditions : FlowConditions

    Returns
    -------
    FlowSolution

    Raises
    ------
    FlowError
        No inlet, no outlet, isolated part, zero-length vessel, conditions that leave the
        pressure undetermined.
    """
    measured = integrals(network)
    resistance = resistance_of(network, conditions.viscosity_pa_s, measured)
    boundary = place_conditions(network, conditions)
    pressure, flow = _solve(boundary.slot[network.vessel_nodes], 1.0 / resistance, boundary)
    radius = measured[1] / measured[0]
    return FlowSolution(
        pressure=pressure[boundary.slot],
        flow=flow,
        velocity=flow / (np.pi * radius**2),
        wall_shear=4.0 * conditions.viscosity_pa_s * flow / (np.pi * radius**3),
        resistance=resistance,
    )


def node_inflow(network: VesselNetwork, flow: FloatArray) -> FloatArray:
    """Flow that enters the network at each node, (m,), µL/s: 0 but at inlets and outlets."""
    leaving, entering = (
        np.bincount(end, weights=flow, minlength=len(network.nodes))
        for end in network.vessel_nodes.T
    )
    return np.asarray(leaving - entering, dtype=np.float64)


def _solve(
    ends: IntArray, conductance: FloatArray, boundary: Boundary
) -> tuple[FloatArray, FloatArray]:
    """Pressure of each unknown and flow of each vessel."""
    system = factorise(ends, conductance, boundary.fixed)
    # Measured from the lowest given pressure, the outlets of most networks drop out of the sums.
    datum = float(boundary.pressure[boundary.fixed].min())
    pressure, flow = system.balanced(boundary.injected, boundary.pressure - datum)
    pressure += datum
    pressure[boundary.fixed] = boundary.pressure[boundary.fixed]
    return pressure, flow
