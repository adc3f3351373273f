"""Scale a network and its flow conditions to a print of another size, at equal wall shear.

In a network scaled by s with the same fluid, Poiseuille's law Δp = 8 μ L Q / (π r⁴) and the wall
shear τ = 4 μ Q / (π r³) give two ways to keep something:

========== ======== ============ ========== =================
kept       flow     pressure     wall shear Reynolds number
========== ======== ============ ========== =================
wall shear s³ Q     Δp           τ          s² Re
Reynolds   s Q      Δp / s²      τ / s²     Re
========== ======== ============ ========== =================

A print is perfused at the same wall shear, which is what cells feel; outlet pressures stay.
"""

from __future__ import annotations

from dataclasses import replace

from design.hemodynamics.conditions import FlowConditions
from design.network import VesselNetwork


def scaled_network(network: VesselNetwork, factor: float) -> VesselNetwork:
    """The network with every length times ``factor``, about the origin."""
    if factor == 1:
        return network
    return replace(
        network,
        nodes=network.nodes * factor,
        points=network.points * factor,
        radius=network.radius * factor,
    )


def same_shear_conditions(conditions: FlowConditions, factor: float) -> FlowConditions:
    """Conditions under which the scaled network's wall shear is the design's."""
    if factor == 1:
        return conditions
    flow, outlets = conditions.inlet_flow_ul_s, conditions.outlet_flow_ul_s
    losses = conditions.losses
    narrow = (replace(s, length_mm=s.length_mm * factor) for s in losses.stenoses)
    return replace(
        conditions,
        losses=replace(losses, stenoses=tuple(narrow)),
        behind={
            node: replace(behind, resistance=behind.resistance / factor**3)
            for node, behind in conditions.behind.items()
        },
        supplies=tuple(
            replace(supply, flow_ul_s=supply.flow_ul_s * factor**3)
            for supply in conditions.supplies
        ),
        inlet_flow_ul_s=None if flow is None else flow * factor**3,
        outlet_flow_ul_s={node: out * factor**3 for node, out in outlets.items()},
    )


def scaled_flow(summary: dict[str, float], factor: float) -> dict[str, dict[str, float]]:
    """What the design's flow asks of a print of ``factor``, both ways.

    Parameters
    ----------
    summary : dict
        Of the design, with ``inflow_ml_min`` and ``pressure_drop_mmhg`` (`flow_summary`).
    factor : float

    Returns
    -------
    dict
        ``design``, ``same_wall_shear`` and ``same_reynolds``: flow (mL/min) and pressure (mmHg).
    """
    flow, drop = summary["inflow_ml_min"], summary["pressure_drop_mmhg"]
    return {
        "design": {"inflow_ml_min": flow, "pressure_drop_mmhg": drop},
        "same_wall_shear": {"inflow_ml_min": flow * factor**3, "pressure_drop_mmhg": drop},
        "same_reynolds": {"inflow_ml_min": flow * factor, "pressure_drop_mmhg": drop / factor**2},
    }
