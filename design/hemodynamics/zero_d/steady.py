"""Solve steady 0D flow in any graph of vessels for node pressures and vessel flows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from design.errors import FlowError
from design.hemodynamics.conditions import FlowConditions
from design.hemodynamics.pressure_drops import (
    Drop,
    Drops,
    Pipes,
    drops_of,
    loss_terms,
    measure_pipes,
    speed_and_shear,
)
from design.hemodynamics.zero_d.boundary import (
    checked_ends,
    place_at,
    place_conditions,
)
from design.hemodynamics.zero_d.nodal import Structure, structure_of
from design.network import VesselNetwork
from design.notebook import NotebookView, span
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True, repr=False)
class FlowSolution(NotebookView):
    """Steady 0D flow; conserved to rounding at every node.

    Attributes
    ----------
    pressure : (m,) float64, Pa
        At the network's nodes.
    flow : (v,) float64, µL/s
        In each vessel, positive from its first node to its last.
    velocity : (v,) float64, mm/s
        Mean over the cross-section at the length-weighted mean radius, signed like `flow`.
    wall_shear : (v,) float64, Pa
        4 μ Q / (π r³) at the mean radius, signed like `flow`, μ the apparent viscosity there.
    resistance : (v,) float64, Pa·s/µL
        What viscosity takes in each vessel, over its flow.
    loss : (v,) float64, Pa, or None
        What inertia takes at bifurcations and stenoses, signed like `flow`.
    """

    pressure: FloatArray
    flow: FloatArray
    velocity: FloatArray
    wall_shear: FloatArray
    resistance: FloatArray
    loss: FloatArray | None = None

    def _facts(self) -> Mapping[str, str]:
        return {
            "vessels": f"{len(self.flow)}",
            "flow": span(np.abs(self.flow), "µL/s"),
            "pressure": span(self.pressure, "Pa"),
            "wall shear": span(np.abs(self.wall_shear), "Pa"),
        }

    def _columns(self) -> Mapping[str, Any]:
        columns = {
            "flow_ul_s": self.flow,
            "velocity_mm_s": self.velocity,
            "wall_shear_pa": self.wall_shear,
            "resistance_pa_s_ul": self.resistance,
        }
        return columns if self.loss is None else columns | {"loss_pa": self.loss}

    def _draw(self, axes: Any) -> None:
        axes.scatter(np.abs(self.flow), np.abs(self.wall_shear))
        axes.set_xlabel("flow of a vessel (µL/s)")
        axes.set_ylabel("wall shear (Pa)")


@dataclass(frozen=True)
class FlowStructure:
    """The part of a flow problem that radii, viscosity and the conditions' numbers don't change.

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
    inlets, outlets = checked_ends(network, conditions)
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
    structure : FlowStructure, optional
        Of the same vessels and the same kind of conditions (`flow_structure`): radii, lengths,
        viscosity, flows and pressures may differ.

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
    losses, nodal, given = conditions.losses, known.nodal, boundary.above_lowest()
    if conditions.whole_fluid.linear and not losses.any:
        loss, viscosity = None, _viscosities(network, pipes, conditions)
        resistance, conductance = pipes.conductance(viscosity)
        system = nodal.factorise(conductance, boundary.ground)
        pressure, flow = system.balanced(boundary.injected, given)
    else:
        terms = None
        if losses.any:
            terms = loss_terms(network, pipes.radius, losses, conditions.density)
        pipes.resistance(1.0)
        drops = drops_of(network, pipes, conditions.whole_fluid, terms)
        problem = DropProblem(nodal, drops, boundary.injected, given, boundary.ground)
        pressure, flow, drop = problem.solve()
        loss, viscosity = None if terms is None else drop.loss, drops.viscosity(flow)
        resistance = drop.resistance
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


class NewtonLimits(NamedTuple):
    """When Newton's method on the vessels' laws begins, damps and stops.

    Newton's method on the vessels' laws Δp = f(Q): each step is a linear network in which a vessel
    has the resistance f'(Q) and a source of pressure f(Q) - f'(Q) Q, solved as steady flow is.
    Every law here rises with Q, so there is one solution (it is the least of a convex function,
    Millar's content) and a step that is halved until it helps finds it. Mass is conserved in each
    step to rounding.

    Fixed-point iteration on the resistance f(Q)/Q converges for shear-thinning fluids only
    linearly, by a factor of 1 - n, and hardly where losses rule; two such steps begin, to leave the
    start.
    """

    settled: float = 1e-11
    """Largest pressure left over in a vessel, of the largest in the network."""
    steps: int = 60
    halvings: int = 12
    """Of one step."""
    fixed_point_steps: int = 2
    start_rate: float = 100.0
    """Wall shear rate, 1/s, whose resistance the first guess has in every vessel."""


NEWTON: Final = NewtonLimits()


@dataclass(frozen=True)
class DropProblem:
    """Vessels' laws and what is given at unknowns (s,), as `NodalSystem.solve` takes them."""

    structure: Structure
    drops: Drops
    injected: FloatArray
    given: FloatArray
    ground: FloatArray | None

    def solve(self) -> tuple[FloatArray, FloatArray, Drop]:
        """Return pressures (s,), flows (v,) and their drops.

        Raises `FlowError` when the iteration doesn't settle, with how far it came.
        """
        pressure, flow = self._first_flows()
        for _ in range(NEWTON.steps):
            drop = self.drops.at(flow)
            left = self._left_over(pressure, drop.whole(flow))
            scale = max(float(np.abs(drop.whole(flow)).max()), float(np.ptp(pressure)), 1e-300)
            if float(np.abs(left).max()) <= NEWTON.settled * scale:
                return pressure, flow, drop
            to_pressure, to_flow = self._linear(drop.slope, drop.whole(flow) - drop.slope * flow)
            before, share = float((left**2 / drop.slope).sum()), 1.0
            for _ in range(NEWTON.halvings):
                next_flow = flow + share * (to_flow - flow)
                next_pressure = pressure + share * (to_pressure - pressure)
                after = self._left_over(next_pressure, self.drops.at(next_flow).whole(next_flow))
                if float((after**2 / drop.slope).sum()) <= (1.0 - 0.1 * share) * before:
                    break
                share *= 0.5
            flow = flow + share * (to_flow - flow)
            pressure = pressure + share * (to_pressure - pressure)
        worst = int(np.abs(left).argmax())
        raise FlowError(
            f"the flow didn't settle in {NEWTON.steps} steps: {abs(left[worst]):.3g} Pa of "
            f"{scale:.3g} Pa are left over in vessel {worst} at {flow[worst]:.3g} µL/s; check the "
            "fluid's numbers, the losses and the network's unit"
        )

    def _first_flows(self) -> tuple[FloatArray, FloatArray]:
        radius = self.drops.pipes.radius
        none = np.zeros(len(radius))
        start = NEWTON.start_rate * np.pi / 4.0 * radius**3
        pressure, flow = self._linear(self.drops.at(start).resistance, none)
        for _ in range(NEWTON.fixed_point_steps):
            drop = self.drops.at(flow)
            secant = drop.resistance + np.abs(drop.loss) / np.maximum(np.abs(flow), 1e-300)
            pressure, flow = self._linear(secant, none)
        return pressure, flow

    def _linear(self, resistance: FloatArray, source: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Q = (p₀ - p₁ - e)/R with Σ Q as injected."""
        structure, count = self.structure, len(self.injected)
        conductance = 1.0 / resistance
        driven = conductance * source
        entering = self.injected + np.bincount(structure.first, weights=driven, minlength=count)
        entering -= np.bincount(structure.last, weights=driven, minlength=count)
        system = structure.factorise(conductance, self.ground)
        pressure, flow = system.balanced(np.where(structure.fixed, 0.0, entering), self.given)
        flow -= driven
        # What the difference leaves over, relative to flows that may be smaller than its terms.
        injected = np.where(structure.fixed, 0.0, self.injected)
        excess, _ = system.excess(injected, pressure, flow)
        more_pressure, more_flow = system.solve(excess, np.zeros(count))
        return pressure + more_pressure, flow + more_flow

    def _left_over(self, pressure: FloatArray, whole: FloatArray) -> FloatArray:
        return pressure[self.structure.first] - pressure[self.structure.last] - whole


def flow_and_sensitivity(
    network: VesselNetwork,
    conditions: FlowConditions,
    vessels: IntArray,
    resistance: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Flow in every vessel, and its derivatives by the logarithms of some vessels' radii.

    A vessel whose radii all grow by the factor s has s⁴ times the conductance, tapered or not.
    With A Y Aᵀ p = s, the derivative by ln s of vessel k solves the same system, factorised once,
    for a pair of sources ∓4 Q_k at the vessel's ends.

    Parameters
    ----------
    conditions : FlowConditions
        Newtonian, without losses.
    vessels : (k,) int64
        Whose radii change.
    resistance : (v,) float64, Pa·s/µL, optional
        Of the vessels, where Poiseuille's isn't meant.

    Returns
    -------
    flow : (v,) float64, µL/s
    slope : (v, k) float64, µL/s
        dQ / d ln r.

    Raises
    ------
    FlowError
        As `solve_flow`; for a fluid or losses that make the problem nonlinear.
    """
    if not conditions.whole_fluid.linear or conditions.losses.any:
        raise FlowError("derivatives by radii are for Newtonian flow without losses; drop those")
    if resistance is None:
        resistance = measure_pipes(network).resistance(conditions.viscosity_pa_s)
    boundary = place_conditions(network, conditions)
    ends = boundary.slot[network.vessel_nodes]
    nodal = structure_of(ends, boundary.fixed)
    system = nodal.factorise(1.0 / resistance, boundary.ground)
    _, flow = system.balanced(boundary.injected, boundary.above_lowest())
    none = np.zeros(len(boundary.fixed))
    slope = np.empty((len(flow), len(vessels)))
    for column, vessel in enumerate(vessels.tolist()):
        source = none.copy()
        source[ends[vessel, 0]] -= 4.0 * flow[vessel]
        source[ends[vessel, 1]] += 4.0 * flow[vessel]
        source[boundary.fixed] = 0.0
        slope[:, column] = system.balanced(source, none)[1]
        slope[vessel, column] += 4.0 * flow[vessel]
    return flow, slope
