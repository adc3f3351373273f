"""Stage 1: load or build the tissue volume, and write its surface."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from design.solids import Solid, write_stl
from printctl.pipeline.context import RunContext
from printctl.pipeline.stage import Stage
from printctl.progress import Report
from printctl.run_folder.artefacts import SURFACE


def depends(context: RunContext) -> Any:
    """The section, and the user's files where it names some."""
    part = context.recipe.tissue
    section = part.model_dump(mode="json")
    section["digests"] = context.digests(part.files())
    return [section, context.recipe.print_scale]


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Prepare the tissue, keep its surface in the print's size, and say what was done to it."""
    tissue, scale = context.tissue, context.recipe.print_scale
    surface = tissue.surface
    write_stl(context.folder / SURFACE, Solid(surface.vertices * scale, surface.faces))
    for note in tissue.notes:
        context.bars.remark("tissue", note)
    extent = tissue.bounds[1] - tissue.bounds[0]
    notes = [*tissue.notes, *([f"Printed {scale:g} times this size."] if scale != 1 else [])]
    summary = {
        "name": context.recipe.tissue.label,
        "volume_mm3": tissue.volume_mm3,
        "extent_mm": extent.tolist(),
        "faces": len(tissue.surface.faces),
        "notes": notes,
        "mean_demand": tissue.demand.mean_weight,
    }
    return summary, [SURFACE]


STAGE = Stage("tissue", depends, (), ("kernels", "design"), work)
