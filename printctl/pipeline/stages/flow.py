"""Stage 3: 0D flow in the network."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from design.hemodynamics import (
    FlowConditions,
    FlowSolution,
    flow_summary,
    flow_table,
    solve_flow,
    write_flow_csv,
)
from design.network import VesselNetwork
from design.network_vtp import write_network_vtp
from design.units import PA_PER_MMHG, UL_S_PER_ML_MIN
from printctl.pipeline.context import NETWORK, RunContext
from printctl.progress import Report
from printctl.pipeline.stage import Stage
from printctl.recipe.parts import FlowPart

TABLE, PICTURE = "flow.csv", "network.vtp"


def solve(network: VesselNetwork, part: FlowPart) -> FlowSolution:
    """Solve the network as the recipe perfuses it."""
    conditions = FlowConditions(
        viscosity_pa_s=part.viscosity_mpa_s * 1e-3,
        inlet_flow_ul_s=part.inlet_flow_ml_min * UL_S_PER_ML_MIN,
        outlet_pressure_pa=part.outlet_pressure_mmhg * PA_PER_MMHG,
    )
    return solve_flow(network, conditions)


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Solve and write the table per vessel, and the network for ParaView."""
    network = context.network
    solution = solve(network, context.recipe.flow)
    write_flow_csv(context.folder / TABLE, network, solution)
    values = {"flow_ul_s": solution.flow, "wall_shear_pa": solution.wall_shear}
    write_network_vtp(context.folder / PICTURE, network, values)
    summary = flow_summary(network, solution)
    return {**summary, "vessels": flow_table(network, solution)}, [TABLE, PICTURE]


STAGE = Stage(
    "flow",
    lambda context: context.recipe.flow.model_dump(mode="json"),
    (NETWORK,),
    ("design",),
    work,
)
