"""Derive vessel resistances and radii from a 3D solution, so that 0D gives the same flows.

Along a vessel, clear of the junctions, a lumen has Poiseuille's resistance. At the junctions
fillets and overlapping lumens widen it, turning and developing flow costs pressure. That loss or
gain is counted as the vessel's own, at the end where it occurs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from design.hemodynamics.conditions import FlowConditions, rescaled
from design.hemodynamics.pressure_drops import heads_of, measure_pipes
from design.hemodynamics.probes import Probes, clear_parts
from design.hemodynamics.three_d.solution import ThreeDSolution
from design.hemodynamics.three_d.vessels.sections import is_clear, probe_steady, vessel_flows
from design.hemodynamics.zero_d.steady import solve_flow
from design.network import VesselNetwork
from kernels.arrays import BoolArray, FloatArray

_LEAST: Final = 0.01
"""Least resistance over the nominal one; its inverse is the greatest."""
_STILL: Final = 1e-4
"""Of the inlet's flow: below it a vessel's resistance is unknown."""


@dataclass(frozen=True)
class Effective:
    """Resistances and radii of a network that reproduce 3D flow; arrays are (v,) by default.

    Attributes
    ----------
    network : VesselNetwork
        The same graph; each vessel's radii scaled so that Poiseuille gives `resistance`.
    flow : float64, µL/s
        In 3D; NaN as `vessel_flows`.
    pressure : (m,) float64, Pa
        At nodes in 3D: a port's mean; where vessels meet, nearest to what their clear parts
        have when extrapolated to the node.
    resistance : float64, Pa·s/µL
        Fall of pressure from node to node over flow.
    nominal : float64, Pa·s/µL
        Poiseuille's, of the network's own radii.
    clear : float64
        Resistance of the part clear of the junctions over its nominal one.
    loss : (v, 2) float64, Pa
        Lost, from first node to last, at the first end and at the last beyond the nominal.
    known : bool
        Whether the resistance is known. Elsewhere it is the nominal one (hardly any flow, or an
        unknown one), or a hundredth of it (no fall of pressure: a short piece amid a junction).
    """

    network: VesselNetwork
    flow: FloatArray
    pressure: FloatArray
    resistance: FloatArray
    nominal: FloatArray
    clear: FloatArray
    loss: FloatArray
    known: BoolArray


@dataclass(frozen=True)
class Gap:
    """Differences between a lumped solution and 3D.

    Attributes
    ----------
    flow : float
        Largest difference of a vessel's flow that is known in 3D, of the inlet's.
    pressure : float
        Largest difference at a node, of the largest difference between nodes.
    """

    flow: float
    pressure: float


def effective_network(
    network: VesselNetwork, conditions: FlowConditions, solution: ThreeDSolution
) -> Effective:
    """Derive resistances and radii such that 0D gives the 3D solution's flows.

    Parameters
    ----------
    network : VesselNetwork
        The one that was meshed.
    conditions : FlowConditions
        Those of the solution.
    solution : ThreeDSolution

    Raises
    ------
    FlowError
        As `probe_steady`.
    """
    parts = clear_parts(network)
    vessels = np.arange(network.vessel_count)
    first, last = (Probes(vessels, parts[:, side]) for side in (0, 1))
    begin, end = (probe_steady(network, each, solution.field) for each in (first, last))
    through = vessel_flows(network, solution)
    known = np.isfinite(through)
    # Nodal pressures need some flow in every vessel.
    flow = np.where(known, through, 0.0 if known.all() else solve_flow(network, conditions).flow)
    nominal = measure_pipes(network).resistance(conditions.viscosity_pa_s)
    before, until = (_before(network, each, conditions.viscosity_pa_s) for each in (first, last))
    at_ends = np.stack(
        [begin.pressure[:, 0] + before * flow, end.pressure[:, 0] - (nominal - until) * flow],
        axis=1,
    )
    pressure = _at_nodes(network, at_ends, nominal * flow, solution)
    nodal = pressure[network.vessel_nodes]
    loss = np.stack([nodal[:, 0] - at_ends[:, 0], at_ends[:, 1] - nodal[:, 1]], axis=1)
    still = _STILL * np.abs(flow).max()
    safe = np.where(known & (np.abs(flow) > still), flow, np.inf)
    ratio = (nodal[:, 0] - nodal[:, 1]) / safe / nominal
    sure = known & (ratio > _LEAST) & (ratio < 1.0 / _LEAST)
    ratio = np.where(np.isfinite(safe), np.clip(ratio, _LEAST, 1.0 / _LEAST), 1.0)
    fall = begin.pressure[:, 0] - end.pressure[:, 0]
    clear = np.where(np.isfinite(safe), fall / safe / (until - before), 1.0)
    return Effective(
        rescaled(network, ratio**-0.25),
        through,
        pressure,
        ratio * nominal,
        nominal,
        clear,
        loss,
        sure,
    )


def flow_error(network: VesselNetwork, conditions: FlowConditions, effective: Effective) -> Gap:
    """Compare 0D of ``network`` (the nominal one, or `Effective.network`) with 3D.

    Raises
    ------
    FlowError
        As `solve_flow`.
    """
    lumped = solve_flow(network, conditions)
    return Gap(
        float(np.nanmax(np.abs(lumped.flow - effective.flow))) / inflow_of(network, effective.flow),
        float(np.abs(lumped.pressure - effective.pressure).max())
        / float(np.ptp(effective.pressure)),
    )


def inflow_of(network: VesselNetwork, flow: FloatArray) -> float:
    """Return the flow that enters at the free ends, µL/s."""
    net = np.zeros(len(network.nodes))
    np.add.at(net, network.vessel_nodes[:, 0], flow)
    np.subtract.at(net, network.vessel_nodes[:, 1], flow)
    free = network.degree() == 1
    return float(np.clip(net[free], 0.0, None).sum())


def _before(network: VesselNetwork, probes: Probes, viscosity: float) -> FloatArray:
    """Return the nominal resistance from each vessel's first node to its probe, (v,)."""
    return measure_pipes(heads_of(network, probes)).resistance(viscosity)


def _at_nodes(
    network: VesselNetwork, at_ends: FloatArray, nominal_fall: FloatArray, solution: ThreeDSolution
) -> FloatArray:
    """Fit a pressure to every node, (m,), Pa, by least squares.

    To the clear parts of vessels, extrapolated to the node, and to the nominal fall of vessels too
    short for a clear part; each over the vessel's own fall. A port has its mean.
    """
    clear, held = is_clear(network), np.full(len(network.nodes), np.nan)
    for port, pressure in zip(
        solution.field.mesh.ports, solution.port_pressure.tolist(), strict=True
    ):
        if port.node >= 0:
            held[port.node] = pressure
    floor = _STILL * float(np.ptp(solution.port_pressure)) or 1.0
    weight = 1.0 / np.maximum(np.abs(nominal_fall), floor)
    first, last = network.vessel_nodes.T
    long, short = np.flatnonzero(clear), np.flatnonzero(~clear)
    node = np.concatenate([first[long], last[long]])
    many, few = len(node), len(short)
    matrix = np.zeros((many + few, len(network.nodes)))
    matrix[np.arange(many), node] = np.tile(weight[long], 2)
    matrix[many + np.arange(few), first[short]] += weight[short]
    matrix[many + np.arange(few), last[short]] -= weight[short]
    wanted = np.concatenate(
        [(at_ends[long] * weight[long, None]).T.ravel(), nominal_fall[short] * weight[short]]
    )
    known = np.isfinite(held)
    at_nodes = np.where(known, held, 0.0)
    rest = wanted - matrix @ at_nodes
    at_nodes[~known] = np.linalg.lstsq(matrix[:, ~known], rest, rcond=1e-12)[0]
    return at_nodes
