"""Export a run's solids in the formats that its recipe names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from design.solids import (
    Solid,
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

WRITERS: Final[dict[str, Callable[[Path, Solid], None]]] = {
    "stl": write_stl,
    "3mf": write_3mf,
    "ply": write_ply,
    "obj": write_obj,
    "vtp": write_solid_vtp,
}


def write_solids(context: RunContext, built: RunSolids) -> tuple[list[str], dict[str, Any]]:
    """Write all files; return their names, and what STEP holds.

    STL is always written, as later stages read it; 3MF holds the construct alone, STEP the lumens.
    """
    part, names = context.recipe.solid, []
    solids = {"lumen": built.lumen, "solid": built.construct, "chamber": built.chamber}
    for kind in dict.fromkeys(("stl", *part.formats)):
        for name, solid in solids.items():
            if solid is None or kind == "step" or (kind, name) == ("3mf", "lumen"):
                continue
            names.append(f"{name}.{kind}")
            WRITERS[kind](context.folder / names[-1], solid)
    if "step" not in part.formats:
        return names, {}
    names.append("lumen.step")
    return names, {names[-1]: write_step(context.folder / names[-1], context.network)}


def checkable(name: str) -> bool:
    """Whether a file can be read back as a mesh."""
    return Path(name).suffix in SUFFIXES
