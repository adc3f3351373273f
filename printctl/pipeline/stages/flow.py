"""Stage 3: 0D flow in the network, and 1D flow if the recipe asks for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from design.hemodynamics import scaled_flow
from design.network_files.vtp import write_network_vtp
from printctl.flow import (
    ONE_D,
    ONE_D_WAVES,
    PULSES,
    TABLE,
    WAVES,
    CsvTables,
    one_d_options,
    pulsatile_conditions,
    solve_and_write,
    solve_and_write_one_d,
    solve_steady,
)
from printctl.pipeline.context import RunContext
from printctl.pipeline.stage import Stage
from printctl.progress import Report
from printctl.recipe.pulse import PulsePart
from printctl.recipe.waves import OneDPart
from printctl.run_folder.artefacts import NETWORK

PICTURE = "network.vtp"


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Solve and write the table per vessel, and the network for ParaView.

    All in the print's size, at the design's wall shear.
    """
    network, driven, driven_by = context.network, context.conditions, context.recipe.flow
    solution, summary = solve_steady(CsvTables(context.folder), network, driven, driven_by)
    values = {"flow_ul_s": solution.flow, "wall_shear_pa": solution.wall_shear}
    write_network_vtp(context.folder / PICTURE, network, values)
    summary["inlet_flow_ml_min"] = summary["inflow_ml_min"]
    if context.recipe.print_scale != 1:
        summary["print_scale"] = context.recipe.print_scale
        summary["scaled"] = scale_to_print(context, summary)
    written = [TABLE, PICTURE]
    if driven_by.pulse is not None:
        summary["pulsatile"] = pulses(context, driven_by.pulse)
        written += [PULSES, WAVES]
        if driven_by.one_d is not None:
            summary["one_d"] = waves(context, driven_by.pulse, driven_by.one_d, report)
            written += [ONE_D, ONE_D_WAVES]
    return summary, written


def pulses(context: RunContext, pulse: PulsePart) -> dict[str, Any]:
    """The periodic state that the recipe asks for, in the print's size."""
    recipe = context.recipe
    conditions = pulsatile_conditions(
        recipe.flow, pulse, context.recipe_folder, recipe.print_scale, context.network
    )
    return solve_and_write(CsvTables(context.folder), context.network, conditions, pulse.steps)


def waves(context: RunContext, pulse: PulsePart, part: OneDPart, report: Report) -> dict[str, Any]:
    """The same along the vessels, in the print's size."""
    recipe = context.recipe
    conditions = pulsatile_conditions(
        recipe.flow, pulse, context.recipe_folder, recipe.print_scale, context.network
    )
    options = one_d_options(part, pulse.steps)

    def tell(cycle: int, change: float) -> None:
        done = min(1.0, np.log(change) / np.log(options.tolerance)) if change > 0.0 else 1.0
        report(max(0.0, float(done)), f"1D, cycle {cycle}")

    return solve_and_write_one_d(
        CsvTables(context.folder), context.network, conditions, options, tell
    )


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
    return [*settings, context.digests(named)] if named else settings


STAGE = Stage(
    "flow",
    key,
    (NETWORK,),
    ("design",),
    work,
)
