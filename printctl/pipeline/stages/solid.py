"""Stage 4: lumens and construct as watertight solids, validated on the files read back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from design.solids import (
    Solid,
    construct_solid,
    lumen_solid,
    read_solid,
    validate_file,
    write_3mf,
    write_stl,
)
from design.vasculature import PLANAR_DIMPLES
from printctl.pipeline.context import LUMEN, NETWORK, SOLID, RunContext
from printctl.pipeline.progress import Report
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.tissue import SURFACE
from printctl.recipe.parts import NamedNetwork

SOLID_3MF = "solid.3mf"


def make_solids(context: RunContext) -> tuple[Solid, Solid]:
    """Lumens, and the body without them (with fiducial dimples where the design has any)."""
    body = read_solid(context.folder / SURFACE, unit="mm")
    named = isinstance(context.recipe.vasculature, NamedNetwork)
    lumen = lumen_solid(context.network)
    return lumen, construct_solid(
        body, context.network, dimples=PLANAR_DIMPLES if named else ()
    )


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Build, write, read back, check."""
    lumen, construct = make_solids(context)
    report(0.6, "writing")
    write_stl(context.folder / LUMEN, lumen)
    write_stl(context.folder / SOLID, construct)
    write_3mf(context.folder / SOLID_3MF, construct)
    report(0.8, "reading back")
    names = (LUMEN, SOLID, SOLID_3MF)
    checks = {name: vars(validate_file(context.folder / name)) for name in names}
    summary = {
        "volume_mm3": construct.volume_mm3,
        "lumen_volume_mm3": lumen.volume_mm3,
        "faces": len(construct.faces),
        "files": checks,
    }
    return summary, names


STAGE = Stage(
    "solid",
    lambda context: isinstance(context.recipe.vasculature, NamedNetwork),
    (SURFACE, NETWORK),
    ("kernels", "design"),
    work,
)
