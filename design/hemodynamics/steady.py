"""Steady 0D flow in any graph of vessels."""

from __future__ import annotations

import numpy as np

from design.hemodynamics.boundary import Boundary, place_conditions
from design.hemodynamics.conditions import FlowConditions
from design.hemodynamics.conductance import factorise
from design.hemodynamics.flow import FlowSolution
from design.hemodynamics.resistance import vessel_resistance
from design.network import FloatArray, IntArray, VesselNetwork

_REFINEMENTS = 6
_BALANCED = 4.0 * float(np.finfo(np.float64).eps)


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
    resistance = vessel_resistance(network, conditions.viscosity_pa_s)
    boundary = place_conditions(network, conditions)
    pressure, flow = _solve(boundary.slot[network.vessel_nodes], 1.0 / resistance, boundary)
    radius = network.mean_radius()
    return FlowSolution(
        pressure=pressure[boundary.slot],
        flow=flow,
        velocity=flow / (np.pi * radius**2),
        wall_shear=4.0 * conditions.viscosity_pa_s * flow / (np.pi * radius**3),
        resistance=resistance,
    )


def node_inflow(network: VesselNetwork, flow: FloatArray) -> FloatArray:
    """Flow that enters the network at each node, (m,), µL/s: 0 but at inlets and outlets."""
    leaving, entering = _end_sums(network.vessel_nodes, flow, len(network.nodes))
    return leaving - entering


def _solve(
    ends: IntArray, conductance: FloatArray, boundary: Boundary
) -> tuple[FloatArray, FloatArray]:
    """Pressure of each unknown and flow of each vessel."""
    system = factorise(ends, conductance, boundary.fixed)
    # Measured from the lowest given pressure, the outlets of most networks drop out of the sums.
    datum = float(boundary.pressure[boundary.fixed].min())
    pressure, flow = system.solve(boundary.injected, boundary.pressure - datum)
    for _ in range(_REFINEMENTS):
        leaving, entering = _end_sums(ends, flow, len(pressure))
        excess = np.where(boundary.fixed, 0.0, boundary.injected - leaving + entering)
        through = sum(_end_sums(ends, np.abs(flow), len(pressure)), np.abs(boundary.injected))
        if np.all(np.abs(excess) <= _BALANCED * through):
            break
        more_pressure, more_flow = system.solve(excess, np.zeros(len(pressure)))
        pressure, flow = pressure + more_pressure, flow + more_flow
    pressure += datum
    pressure[boundary.fixed] = boundary.pressure[boundary.fixed]
    return pressure, flow


def _end_sums(ends: IntArray, flow: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Sum over the vessels that begin, and over those that end, at each unknown."""
    first, last = (np.bincount(end, weights=flow, minlength=count) for end in ends.T)
    return np.asarray(first, dtype=np.float64), np.asarray(last, dtype=np.float64)
