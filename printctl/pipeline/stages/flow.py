"""Stage 3: 0D flow in the network."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics import (
    flow_summary,
    flow_table,
    scaled_flow,
    solve_flow,
    write_flow_csv,
)
from design.network_vtp import write_network_vtp
from printctl.pipeline.artefacts import NETWORK
from printctl.pipeline.context import RunContext
from printctl.pipeline.stage import Stage
from printctl.progress import Report

TABLE, PICTURE = "flow.csv", "network.vtp"


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Solve and write the table per vessel, and the network for ParaView.

    All in the print's size, at the design's wall shear.
    """
    network, driven = context.network, context.conditions
    solution = solve_flow(network, driven)
    write_flow_csv(context.folder / TABLE, network, solution)
    values = {"flow_ul_s": solution.flow, "wall_shear_pa": solution.wall_shear}
    write_network_vtp(context.folder / PICTURE, network, values)
    summary: dict[str, Any] = flow_summary(network, solution, driven)
    summary["inlet_flow_ml_min"] = summary["inflow_ml_min"]
    if context.recipe.print_scale != 1:
        summary["print_scale"] = context.recipe.print_scale
        summary["scaled"] = scaled(context, summary)
    return {**summary, "vessels": rows(flow_table(network, solution))}, [TABLE, PICTURE]


def scaled(context: RunContext, summary: dict[str, Any]) -> dict[str, Any]:
    """What the design's flow asks of the print; said on the terminal, too."""
    factor = context.recipe.print_scale
    design = {
        "inflow_ml_min": summary["inflow_ml_min"] / factor**3,
        "pressure_drop_mmhg": summary["pressure_drop_mmhg"],
    }
    found = scaled_flow(design, factor)
    shear, number = found["same_wall_shear"], found["same_reynolds"]
    context.bars.remark(
        "flow",
        f"printed {factor:g} times the design's size: its {design['inflow_ml_min']:.4g} mL/min at "
        f"{design['pressure_drop_mmhg']:.4g} mmHg become {shear['inflow_ml_min']:.4g} mL/min at "
        f"{shear['pressure_drop_mmhg']:.4g} mmHg for the same wall shear, or "
        f"{number['inflow_ml_min']:.4g} mL/min at {number['pressure_drop_mmhg']:.4g} mmHg for the "
        "same Reynolds number",
    )
    return found


def rows(table: dict[str, NDArray[np.generic]]) -> list[dict[str, Any]]:
    """Columns to JSON-ready rows."""
    columns = [column.tolist() for column in table.values()]
    return [dict(zip(table, row, strict=True)) for row in zip(*columns, strict=True)]


STAGE = Stage(
    "flow",
    lambda context: [context.recipe.flow.model_dump(mode="json"), context.recipe.print_scale],
    (NETWORK,),
    ("design",),
    work,
)
