"""Stage 3: 0D flow in the network."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics import (
    FlowConditions,
    flow_summary,
    flow_table,
    solve_flow,
    write_flow_csv,
)
from design.network_vtp import write_network_vtp
from design.units import PA_PER_MMHG, UL_S_PER_ML_MIN
from printctl.pipeline.artefacts import NETWORK
from printctl.pipeline.context import RunContext
from printctl.pipeline.stage import Stage
from printctl.progress import Report
from printctl.recipe.parts import FlowPart

TABLE, PICTURE = "flow.csv", "network.vtp"


def conditions(part: FlowPart) -> FlowConditions:
    """The recipe's words in the design's units."""
    return FlowConditions(
        viscosity_pa_s=part.viscosity_mpa_s * 1e-3,
        inlet_flow_ul_s=part.inlet_flow_ml_min * UL_S_PER_ML_MIN,
        outlet_pressure_pa=part.outlet_pressure_mmhg * PA_PER_MMHG,
    )


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Solve and write the table per vessel, and the network for ParaView."""
    network, driven = context.network, conditions(context.recipe.flow)
    solution = solve_flow(network, driven)
    write_flow_csv(context.folder / TABLE, network, solution)
    values = {"flow_ul_s": solution.flow, "wall_shear_pa": solution.wall_shear}
    write_network_vtp(context.folder / PICTURE, network, values)
    summary: dict[str, Any] = flow_summary(network, solution, driven)
    summary["inlet_flow_ml_min"] = summary["inflow_ml_min"]
    return {**summary, "vessels": rows(flow_table(network, solution))}, [TABLE, PICTURE]


def rows(table: dict[str, NDArray[np.generic]]) -> list[dict[str, Any]]:
    """Columns to JSON-ready rows."""
    columns = [column.tolist() for column in table.values()]
    return [dict(zip(table, row, strict=True)) for row in zip(*columns, strict=True)]


STAGE = Stage(
    "flow",
    lambda context: context.recipe.flow.model_dump(mode="json"),
    (NETWORK,),
    ("design",),
    work,
)
