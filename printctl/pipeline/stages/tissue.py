"""Stage 1: the tissue."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from design.solids import Solid, write_stl
from printctl.pipeline.context import RunContext
from printctl.pipeline.manifest import digest_file
from printctl.pipeline.stage import Stage
from printctl.progress import Report
from printctl.recipe.parts import MeshTissue

SURFACE = "tissue.stl"


def depends(context: RunContext) -> Any:
    """The section, and the user's file where it names one."""
    part = context.recipe.tissue
    found = part.model_dump(mode="json")
    if isinstance(part, MeshTissue) and (context.recipe_folder / part.mesh).is_file():
        found["digest"] = digest_file(context.recipe_folder / part.mesh)
    return found


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Prepare the tissue and keep its surface."""
    tissue = context.tissue
    write_stl(context.folder / SURFACE, Solid(tissue.vertices, tissue.faces))
    part = context.recipe.tissue
    extent = tissue.bounds[1] - tissue.bounds[0]
    summary = {
        "name": part.mesh if isinstance(part, MeshTissue) else part.shape,
        "volume_mm3": tissue.volume_mm3,
        "extent_mm": extent.tolist(),
        "faces": len(tissue.faces),
    }
    return summary, [SURFACE]


STAGE = Stage("tissue", depends, (), ("kernels", "design"), work)
