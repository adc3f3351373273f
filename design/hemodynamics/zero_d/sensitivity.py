"""Compute steady 0D flows and their exact derivatives by vessel radii."""

from __future__ import annotations

import numpy as np

from design.errors import FlowError
from design.hemodynamics.conditions import FlowConditions
from design.hemodynamics.pressure_drops import measure_pipes
from design.hemodynamics.zero_d.boundary import place_conditions
from design.hemodynamics.zero_d.nodal.conductance import structure_of
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray


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
    network : VesselNetwork
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
