"""Solve steady 0D flow in any graph of vessels for node pressures and vessel flows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.errors import FlowError
from design.hemodynamics.conditions import FlowConditions
from design.hemodynamics.pressure_drops import (
    Drops,
    Pipes,
    drops_of,
    loss_terms,
    measure_pipes,
    speed_and_shear,
)
from design.hemodynamics.zero_d.boundary import Boundary, boundary_nodes, check_parts, place_at
from design.hemodynamics.zero_d.flow import FlowSolution
from design.hemodynamics.zero_d.nodal.conductance import Structure, structure_of
from design.hemodynamics.zero_d.nonlinear import solve_drops
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class FlowStructure:
    """What of a flow problem doesn't depend on radii, viscosity and the conditions' numbers.

    Attributes
    ----------
    vessel_nodes : (v, 2) int64
        Of the network that it was found for.
    inlets, outlets : (i,), (o,) int64
    kind : tuple
        Which ends have flows given, which pressures.
    slot : (m,) int64
        Unknown of each node.
    nodal : Structure
    """

    vessel_nodes: IntArray
    inlets: IntArray
    outlets: IntArray
    kind: tuple[object, ...]
    slot: IntArray
    nodal: Structure


def flow_structure(network: VesselNetwork, conditions: FlowConditions) -> FlowStructure:
    """Find, once for many solutions, the order in which a network's unknowns are eliminated.

    Raises
    ------
    FlowError
        As `solve_flow`.
    """
    inlets, outlets = boundary_nodes(network, conditions)
    check_parts(network, inlets, outlets)
    boundary = place_at(len(network.nodes), inlets, outlets, conditions)
    nodal = structure_of(boundary.slot[network.vessel_nodes], boundary.fixed)
    kind = _kind(conditions)
    return FlowStructure(network.vessel_nodes, inlets, outlets, kind, boundary.slot, nodal)


def solve_flow(
    network: VesselNetwork, conditions: FlowConditions, structure: FlowStructure | None = None
) -> FlowSolution:
    """Solve steady flow: each vessel's law Δp(Q), and Σ Q = 0 at each inner node.

    The law is Poiseuille's, Δp = R Q, or that of the conditions' fluid and losses. Loops, tapers,
    several inlets and several parts are allowed. Inlets fed by a flow share one pressure. Branches
    and chains are eliminated in linear time, what loops remain by sparse factorisation. Mass
    is conserved to rounding, relative to the flow through each node, however small the pressure
    differences are beside the pressures: what a solution leaves over at the nodes is solved for
    again and added to the flows themselves.

    Parameters
    ----------
    network : VesselNetwork
    conditions : FlowConditions
    structure : FlowStructure, optional
        Of the same vessels and the same kind of conditions (`flow_structure`): radii, lengths,
        viscosity, flows and pressures may differ.

    Returns
    -------
    FlowSolution

    Raises
    ------
    FlowError
        No inlet, no outlet, isolated part, zero-length vessel, conditions that leave the
        pressure undetermined, a structure of another problem, laws that have no solution.
    """
    known = structure or flow_structure(network, conditions)
    _check(known, network, conditions)
    pipes = measure_pipes(network)
    boundary = place_at(len(network.nodes), known.inlets, known.outlets, conditions, known.slot)
    fluid = conditions.whole_fluid
    if fluid.linear and not conditions.losses.any:
        return _linear(pipes, boundary, known.nodal, _viscosities(network, pipes, conditions))
    terms = (
        loss_terms(network, pipes.radius, conditions.losses, conditions.density)
        if conditions.losses.any
        else None
    )
    pipes.resistance(1.0)
    return _nonlinear(drops_of(network, pipes, fluid, terms), boundary, known.nodal)


def _linear(
    pipes: Pipes, boundary: Boundary, nodal: Structure, viscosity: FloatArray | float
) -> FlowSolution:
    """``viscosity``: that which gives each vessel its resistance, and so its wall shear."""
    resistance, conductance = pipes.conductance(viscosity)
    system = nodal.factorise(conductance, boundary.ground)
    pressure, flow = system.balanced(boundary.injected, boundary.above_lowest())
    return _solution(pipes, boundary, pressure, flow, viscosity, resistance, None)


def _nonlinear(drops: Drops, boundary: Boundary, nodal: Structure) -> FlowSolution:
    given = boundary.above_lowest()
    pressure, flow, drop = solve_drops(nodal, drops, boundary.injected, given, boundary.ground)
    loss = None if drops.losses is None else drop.loss
    viscosity = drops.viscosity(flow)
    return _solution(drops.pipes, boundary, pressure, flow, viscosity, drop.resistance, loss)


def _solution(
    pipes: Pipes,
    boundary: Boundary,
    pressure: FloatArray,
    flow: FloatArray,
    viscosity: FloatArray | float,
    resistance: FloatArray,
    loss: FloatArray | None,
) -> FlowSolution:
    velocity, shear = speed_and_shear(pipes, flow, viscosity)
    return FlowSolution(boundary.at_nodes(pressure), flow, velocity, shear, resistance, loss)


def _viscosities(
    network: VesselNetwork, pipes: Pipes, conditions: FlowConditions
) -> FloatArray | float:
    """One for all, or by each vessel's diameters."""
    if conditions.fluid is None:
        return conditions.viscosity_pa_s
    drops = drops_of(network, pipes, conditions.fluid, None)
    return drops.at(np.zeros(network.vessel_count)).resistance / pipes.per_viscosity


def _kind(conditions: FlowConditions) -> tuple[object, ...]:
    return (
        conditions.inlet_pressure_pa is None,
        frozenset(conditions.outlet_flow_ul_s),
        frozenset(n for n, behind in conditions.behind.items() if behind.resistance > 0.0),
        conditions.inlets,
        conditions.outlets,
        tuple(supply.inlets for supply in conditions.supplies),
    )


def _check(known: FlowStructure, network: VesselNetwork, conditions: FlowConditions) -> None:
    same = known.vessel_nodes is network.vessel_nodes or np.array_equal(
        known.vessel_nodes, network.vessel_nodes
    )
    if not same or known.kind != _kind(conditions):
        raise FlowError(
            "the structure is that of another network, or of other inlets, outlets or kinds of "
            "condition; make one by flow_structure"
        )


def node_inflow(network: VesselNetwork, flow: FloatArray) -> FloatArray:
    """Flow that enters the network at each node, (m,), µL/s: 0 but at inlets and outlets."""
    leaving, entering = (
        np.bincount(end, weights=flow, minlength=len(network.nodes))
        for end in network.vessel_nodes.T
    )
    return np.asarray(leaving - entering, dtype=np.float64)
