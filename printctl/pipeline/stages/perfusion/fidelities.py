"""Stage 3b: 3D flow, and comparison of 0D, 1D and 3D flow, if the recipe asks for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from design.hemodynamics import PulsatileConditions
from printctl.analysis.flow import pulsatile_conditions
from printctl.pipeline.context import RunContext
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.perfusion import flow
from printctl.progress import Report
from printctl.run_folder.artefacts import NETWORK, SURFACE


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Solve in the print's size, in lumens rounded as they are printed."""
    # Heavy (3D flow, plots, lattices), and few recipes ask for it.
    from design.lattices import build_lattice
    from printctl.analysis.flow.fidelities import Case, solve_fidelities
    from printctl.analysis.flow.lattice_comparison import compare_with_lattice

    recipe, network = context.recipe, context.network
    case = Case(
        network, recipe.flow, context.conditions, _pulse(context), recipe.solid.fillet_ratio
    )
    outcome = solve_fidelities(context.folder, case, report)
    for note in outcome.notes:
        context.bars.remark("fidelities", note)
    asked_for = recipe.flow.compare
    if asked_for is not None and asked_for.lattice is not None:
        # In the design's size and at its flow: that is what both were made for.
        lattice = build_lattice(context.tissue, asked_for.lattice.options())
        outcome.summary["beside"], files = compare_with_lattice(
            context.folder, context.designed_network, lattice, context.designed_conditions
        )
        outcome.files += files
    return outcome.summary, outcome.files


def _pulse(context: RunContext) -> PulsatileConditions | None:
    recipe = context.recipe
    if recipe.flow.pulse is None:
        return None
    return pulsatile_conditions(
        recipe.flow, recipe.flow.pulse, context.recipe_folder, recipe.print_scale, context.network
    )


def depends(context: RunContext) -> Any:
    """The flow's section, whole, and the fillets."""
    part = context.recipe.flow
    space = [part.three_d, part.compare]
    settings = [None if x is None else x.model_dump(mode="json") for x in space]
    return [flow.key(context), settings, context.recipe.solid.fillet_ratio]


def is_requested(context: RunContext) -> bool:
    """Whether the recipe asks for either."""
    part = context.recipe.flow
    return part.three_d is not None or part.compare is not None


STAGE = Stage(
    "fidelities",
    depends,
    (SURFACE, NETWORK),
    ("kernels", "design", "registration"),
    work,
    is_requested,
)
