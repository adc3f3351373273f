"""Stage 4: lumens and construct as watertight solids, validated on the files read back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from design.network import VesselNetwork
from design.solids import read_solid, surface_genus, validate_file
from design.vasculature import PLANAR_DIMPLES, Dimple
from printctl.pipeline.artefacts import LUMEN, NETWORK, SOLID
from printctl.pipeline.context import RunContext
from printctl.pipeline.solid_build import Built, build
from printctl.pipeline.solid_files import checkable, write_solids
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.tissue import SURFACE
from printctl.progress import Report
from printctl.recipe.growth import NamedNetwork

SOLID_3MF = "solid.3mf"
NAMES = (LUMEN, SOLID, SOLID_3MF)
"""Files by default."""


def built_solids(context: RunContext, network: VesselNetwork | None = None) -> Built:
    """All solids of the recipe; a design of ours brings its fiducial dimples.

    ``network`` is put in the design's place where it is given.
    """
    named = isinstance(context.recipe.vasculature, NamedNetwork)
    scale = context.recipe.print_scale
    marks = [_scaled(mark, scale) for mark in PLANAR_DIMPLES] if named else []
    tissue = read_solid(context.folder / SURFACE, unit="mm")
    vessels = context.network if network is None else network
    return build(context.recipe.solid, vessels, tissue, body_genus(context), marks)


def _scaled(mark: Dimple, scale: float) -> tuple[tuple[float, float, float], float]:
    x, y, z = mark.centre_mm
    return (x * scale, y * scale, z * scale), mark.diameter_mm * scale


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Build, write, read back, check."""
    built = built_solids(context)
    report(0.6, "writing")
    names, steps = write_solids(context, built)
    report(0.8, "reading back")
    checks = {name: validate_file(context.folder / name) for name in names if checkable(name)}
    for check in checks.values():
        check.require_valid()
        if check.crossing_faces:
            context.bars.remark("solid", f"{check.file}: {check.crossing_faces} faces cross others")
    summary = {
        "volume_mm3": built.construct.volume_mm3,
        "lumen_volume_mm3": built.lumen.volume_mm3,
        "faces": len(built.construct.faces),
        "watertight": True,
        "ports": len(built.ports),
        "fittings": built.fittings,
        "genus": checks[SOLID].genus,
        "genus_expected": built.genus,
        "files": {name: asdict(check) for name, check in checks.items()},
    }
    if steps:
        summary["step"] = {name: asdict(check) for name, check in steps.items()}
    if built.chamber is not None:
        summary["chamber_genus"] = surface_genus(built.chamber.faces)[0]
    return summary, names


def body_genus(context: RunContext) -> int:
    """Handles of the tissue itself (a ring has one)."""
    return validate_file(context.folder / SURFACE).genus or 0


def depends(context: RunContext) -> Any:
    """The section, and whether the design has dimples."""
    named = isinstance(context.recipe.vasculature, NamedNetwork)
    return [context.recipe.solid.model_dump(mode="json"), named]


STAGE = Stage(
    "solid",
    depends,
    (SURFACE, NETWORK),
    ("kernels", "design"),
    work,
)
