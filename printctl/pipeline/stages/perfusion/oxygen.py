"""Stage 3d: oxygen in vessels and tissue, if the recipe asks for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from design.hemodynamics import solve_flow
from printctl.analysis.oxygen import FIELD, SLICE, TABLE, hypoxia, solve_and_write
from printctl.pipeline.context import RunContext
from printctl.pipeline.stage import Stage
from printctl.progress import Report
from printctl.recipe.parts import OxygenPart
from printctl.run_folder.artefacts import NETWORK, SURFACE


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Solve in the print's size, with the print's flow; say on the terminal what is hypoxic."""
    network, part = context.network, context.recipe.oxygen or OxygenPart()
    summary = solve_and_write(
        context.folder,
        network,
        solve_flow(network, context.conditions),
        context.tissue,
        part,
        report,
        context.recipe.print_scale,
    )
    context.bars.remark("oxygen", hypoxia(summary, part))
    return summary, [TABLE, FIELD, SLICE]


def depends(context: RunContext) -> Any:
    """The section, the steady flow's, the user's outlets, and the scale."""
    part, recipe = context.recipe.oxygen, context.recipe
    outlet = recipe.flow.every_outlet
    return [
        None if part is None else part.model_dump(mode="json"),
        {
            **recipe.flow.model_dump(mode="json", exclude={"pulse", "one_d"}),
            "outlet": outlet and outlet.model_dump(mode="json"),
        },
        context.outlets_digest,
        recipe.print_scale,
    ]


def is_requested(context: RunContext) -> bool:
    """Whether the recipe has the section."""
    return context.recipe.oxygen is not None


STAGE = Stage(
    "oxygen", depends, (SURFACE, NETWORK), ("kernels", "design", "registration"), work, is_requested
)
