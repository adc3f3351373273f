"""Export a run's solids in the formats that its recipe names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from design.solids import (
    Solid,
    StepBody,
    write_3mf,
    write_obj,
    write_ply,
    write_solid_vtp,
    write_step,
    write_stl,
)
from design.solids.read import SUFFIXES
from printctl.pipeline.context import RunContext
from printctl.pipeline.solid_build import RunSolids
from printctl.recipe.tissue import Block, Cylinder

WRITERS: Final[dict[str, Callable[[Path, Solid], None]]] = {
    "stl": write_stl,
    "3mf": write_3mf,
    "ply": write_ply,
    "obj": write_obj,
    "vtp": write_solid_vtp,
}


def write_solids(context: RunContext, built: RunSolids) -> tuple[list[str], dict[str, Any]]:
    """Write all files; their names, and what was read back of STEP.

    STL is always written, as later stages read it; 3MF holds the construct alone.
    """
    part, names = context.recipe.solid, []
    solids = {"lumen": built.lumen, "solid": built.construct, "chamber": built.chamber}
    for kind in dict.fromkeys(("stl", *part.formats)):
        for name, solid in solids.items():
            if solid is None or kind == "step" or (kind, name) == ("3mf", "lumen"):
                continue
            names.append(f"{name}.{kind}")
            WRITERS[kind](context.folder / names[-1], solid)
    checks = _write_steps(context, built) if "step" in part.formats else {}
    return [*names, *checks], checks


def checkable(name: str) -> bool:
    """Whether a file can be read back as a mesh."""
    return Path(name).suffix in SUFFIXES


def _write_steps(context: RunContext, built: RunSolids) -> dict[str, Any]:
    """The lumens, and the construct where it is a block or cylinder with lumens and dimples."""
    network = context.network
    files = {"lumen.step": write_step(context.folder / "lumen.step", network)}
    body = _step_body(context)
    if body is None:
        context.bars.remark(
            "solid",
            "solid.step isn't written: only a block or cylinder minus lumens and dimples can be; "
            "lumen.step is, and the other formats hold all",
        )
        return files
    files["solid.step"] = write_step(
        context.folder / "solid.step",
        network,
        body=body,
        dimples=built.dimples,
        extend_ends_mm=built.beyond_mm,
        extend_nodes=built.ports,
    )
    return files


def _step_body(context: RunContext) -> StepBody | None:
    tissue, part = context.recipe.tissue, context.recipe.solid
    fitted = part.tubes or part.inlets or part.outlets or part.texts
    if fitted or tissue.keep_out or tissue.keep_within:
        return None
    low, high = context.bounds
    if isinstance(tissue, Block):
        return StepBody("block", tuple(low.tolist()), tuple(high.tolist()))
    if isinstance(tissue, Cylinder):
        # Its polygon's bounds aren't quite the circle's.
        x, y = (0.5 * (low + high))[:2].tolist()
        half = 0.5 * tissue.diameter_mm * context.recipe.print_scale
        return StepBody(
            "cylinder", (x - half, y - half, float(low[2])), (x + half, y + half, float(high[2]))
        )
    return None
