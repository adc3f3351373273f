"""Stage 3: 0D flow in the network, and 1D flow if the recipe asks for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from design.hemodynamics import scaled_flow
from design.network_files.vtp import write_network_vtp
from printctl.analysis.flow import CsvTables, solve_section
from printctl.analysis.flow.conditions import Driven
from printctl.analysis.flow.exports import EXPORTS, export_notes, write_exports
from printctl.pipeline.context import RunContext
from printctl.pipeline.stage import Stage
from printctl.progress import Report
from printctl.recipe.parts import ThreeDPart
from printctl.run_folder.artefacts import NETWORK

PICTURE = "network.vtp"


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Solve and write the table per vessel, and the network for ParaView.

    All in the print's size, at the design's wall shear.
    """
    recipe, tables = context.recipe, CsvTables(context.folder)
    solution, summary = solve_section(
        tables,
        context.network,
        recipe.flow,
        lambda number, change, goal: report(_periodic(change, goal), f"1D, cycle {number}"),
        steady=context.conditions,
        folder=context.recipe_folder,
        print_scale=recipe.print_scale,
    )
    exported, reported = _exported(context)
    summary |= reported
    if notes := export_notes(reported):
        summary["notes"] = [*summary.get("notes", ()), *notes]
    values = {"flow_ul_s": solution.flow, "wall_shear_pa": solution.wall_shear}
    write_network_vtp(context.folder / PICTURE, context.network, values)
    for note in summary.get("notes", ()):
        context.bars.remark("flow", note)
    summary["inlet_flow_ml_min"] = summary["inflow_ml_min"]
    if recipe.print_scale != 1:
        summary["print_scale"] = recipe.print_scale
        summary["scaled"] = scale_to_print(context, summary)
    return summary, [*(file.name for file in tables.files), PICTURE, *exported]


def _exported(context: RunContext) -> tuple[list[str], dict[str, Any]]:
    """Write the files for other solvers; return their names, and what to report of them."""
    recipe, folder = context.recipe, context.folder
    if not recipe.flow.exports:
        return [], {}
    paths = {name: folder / EXPORTS[name] for name in recipe.flow.exports}
    driven = Driven(recipe.flow, context.recipe_folder, recipe.print_scale)
    space = recipe.flow.three_d or ThreeDPart()
    written, reported = write_exports(
        paths, context.network, driven, space, recipe.solid.fillet_ratio
    )
    files = [file for one in written for file in (one, *one.rglob("*")) if file.is_file()]
    return [file.relative_to(folder).as_posix() for file in files], reported


def _periodic(change: float, goal: float) -> float:
    """How far 1D flow is on its way to being periodic, 0 to 1."""
    done = min(1.0, float(np.log(change) / np.log(goal))) if change > 0.0 else 1.0
    return max(0.0, done)


def scale_to_print(context: RunContext, summary: dict[str, Any]) -> dict[str, Any]:
    """What the design's flow asks of the print; said on the terminal, too."""
    factor = context.recipe.print_scale
    design = {
        "inflow_ml_min": summary["inflow_ml_min"] / factor**3,
        "pressure_drop_mmhg": summary["pressure_drop_mmhg"],
    }
    scaled = scaled_flow(design, factor)
    shear, number = scaled["same_wall_shear"], scaled["same_reynolds"]
    context.bars.remark(
        "flow",
        f"printed {factor:g} times the design's size: its {design['inflow_ml_min']:.4g} mL/min at "
        f"{design['pressure_drop_mmhg']:.4g} mmHg become {shear['inflow_ml_min']:.4g} mL/min at "
        f"{shear['pressure_drop_mmhg']:.4g} mmHg for the same wall shear, or "
        f"{number['inflow_ml_min']:.4g} mL/min at {number['pressure_drop_mmhg']:.4g} mmHg for the "
        "same Reynolds number",
    )
    return scaled


def key(context: RunContext) -> list[Any]:
    """The section, the scale, and the user's tables where it names any."""
    part = context.recipe.flow
    tables = [part.outlets, None if part.pulse is None else part.pulse.table]
    named = [name for name in tables if name is not None]
    section = part.model_dump(mode="json", exclude_none=True, exclude={"three_d", "compare"})
    settings = [section, context.recipe.print_scale]
    if part.exports:
        space = None if part.three_d is None else part.three_d.edge_ratio
        settings += [space, context.recipe.solid.fillet_ratio]
    return [*settings, context.digests(named)] if named else settings


STAGE = Stage(
    "flow",
    key,
    (NETWORK,),
    ("design",),
    work,
)
