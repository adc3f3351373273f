"""Summarise a steady 0D flow solution: totals, extremes and balances."""

from __future__ import annotations

import numpy as np

from design.hemodynamics.conditions import FlowConditions
from design.hemodynamics.zero_d.boundary import boundary_nodes
from design.hemodynamics.zero_d.flow import FlowSolution
from design.hemodynamics.zero_d.steady import node_inflow
from design.hemodynamics.zero_d.validity import entrance_share, poiseuille_holds, reynolds
from design.network import VesselNetwork
from design.units import PA_PER_MMHG, UL_S_PER_ML_MIN, WATER_DENSITY
from kernels.arrays import FloatArray, IntArray

_UW_PER_PA_UL_S = 1e-3


def flow_summary(
    network: VesselNetwork,
    solution: FlowSolution,
    conditions: FlowConditions | None = None,
    density: float | None = None,
) -> dict[str, float]:
    """Totals, extremes and balances for `report.json`; keys name their units.

    ``mass_imbalance`` is the greatest net flow at an inner node over the flow through it.
    ``energy_imbalance`` holds the power that enters and leaves, Σ p Q over inlets and outlets,
    against what viscosity and losses take, Σ R Q² + Σ Δp Q, relative to the latter.
    ``pressure_drop`` is between the network's extremes, and ``resistance`` that drop over the
    inflow (0 where nothing flows).
    ``losses_share``, where losses were asked for, is what junctions and stenoses take of power.
    ``poiseuille_holds_share`` counts vessels in which the flow is laminar and developed but for a
    tenth of the length; ``entrance_share_max`` is the greatest such share.

    Parameters
    ----------
    network : VesselNetwork
    solution : FlowSolution
    conditions : FlowConditions, optional
        Those solved for, where they name inlets or outlets other than the network's own.
    density : float, Pa·s²/mm², optional
        Of the Reynolds numbers; the conditions' by default.
    """
    if density is None:
        density = WATER_DENSITY if conditions is None else conditions.density
    ends = (
        np.concatenate([network.inlets(), network.outlets()])
        if conditions is None
        else np.concatenate(boundary_nodes(network, conditions))
    )
    inflow = node_inflow(network, solution.flow)
    entering = float(np.maximum(inflow[ends], 0.0).sum())
    drop = float(np.ptp(solution.pressure))
    number = reynolds(network, solution, density)
    shear = np.abs(solution.wall_shear)
    dissipated = float(solution.resistance @ solution.flow**2)
    lost = 0.0 if solution.loss is None else float(solution.loss @ solution.flow)
    dissipated += lost
    power = float(solution.pressure[ends] @ inflow[ends])
    losses = {} if solution.loss is None else {"losses_share": lost / max(dissipated, 1e-300)}
    return losses | {
        "vessel_count": float(network.vessel_count),
        "inflow_ul_s": entering,
        "inflow_ml_min": entering / UL_S_PER_ML_MIN,
        "pressure_drop_pa": drop,
        "pressure_drop_mmhg": drop / PA_PER_MMHG,
        "resistance_pa_s_ul": drop / entering if entering > 0.0 else 0.0,
        "wall_shear_min_pa": float(shear.min()),
        "wall_shear_median_pa": float(np.median(shear)),
        "wall_shear_max_pa": float(shear.max()),
        "velocity_max_mm_s": float(np.abs(solution.velocity).max()),
        "reynolds_max": float(number.max()),
        "entrance_share_max": float(entrance_share(network, number).max()),
        "poiseuille_holds_share": float(poiseuille_holds(network, number).mean()),
        "dissipated_uw": dissipated * _UW_PER_PA_UL_S,
        "mass_imbalance": _mass_imbalance(network, solution.flow, inflow, ends),
        "energy_imbalance": abs(power - dissipated) / dissipated if dissipated > 0.0 else 0.0,
    }


def _mass_imbalance(
    network: VesselNetwork, flow: FloatArray, inflow: FloatArray, ends: IntArray
) -> float:
    through = np.zeros(len(network.nodes))
    for column in network.vessel_nodes.T:
        through += np.bincount(column, weights=np.abs(flow), minlength=len(through))
    inner = through > 0.0
    inner[ends] = False
    return float(np.max(np.abs(inflow[inner]) / through[inner], initial=0.0))
