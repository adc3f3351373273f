"""Stage 4: lumens and construct as watertight solids, validated on the files read back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from design.network import IntArray
from design.solids import (
    Solid,
    construct_genus,
    construct_solid,
    lumen_solid,
    open_ends,
    read_solid,
    validate_file,
    write_3mf,
    write_stl,
)
from design.vasculature import PLANAR_DIMPLES
from printctl.pipeline.context import LUMEN, NETWORK, SOLID, RunContext
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.tissue import SURFACE
from printctl.progress import Report
from printctl.recipe.growth import NamedNetwork

SOLID_3MF = "solid.3mf"
NAMES = (LUMEN, SOLID, SOLID_3MF)


def make_construct(context: RunContext) -> tuple[Solid, IntArray]:
    """The body without its lumens (and fiducial dimples, where the design has any); its ports.

    Lumens that end at the body's face are drawn out for the cut, so that they open cleanly.
    """
    body, network = read_solid(context.folder / SURFACE, unit="mm"), context.network
    named = isinstance(context.recipe.vasculature, NamedNetwork)
    marks = [(mark.centre_mm, mark.diameter_mm) for mark in PLANAR_DIMPLES] if named else []
    beyond = 2.0 * float(network.radius.max())
    ports = open_ends(network, body, beyond)
    tool = lumen_solid(
        network,
        extend_ends_mm=beyond,
        extend_nodes=ports,
        fillet_ratio=context.recipe.solid.fillet_ratio,
    )
    return construct_solid(body, tool, dimples=marks), ports


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Build, write, read back, check."""
    lumen = lumen_solid(context.network, fillet_ratio=context.recipe.solid.fillet_ratio)
    report(0.3, "body minus lumens")
    construct, ports = make_construct(context)
    report(0.6, "writing")
    write_stl(context.folder / LUMEN, lumen)
    write_stl(context.folder / SOLID, construct)
    write_3mf(context.folder / SOLID_3MF, construct)
    report(0.8, "reading back")
    checks = {name: validate_file(context.folder / name) for name in NAMES}
    for check in checks.values():
        check.require_valid()
    summary = {
        "volume_mm3": construct.volume_mm3,
        "lumen_volume_mm3": lumen.volume_mm3,
        "faces": len(construct.faces),
        "watertight": True,
        "ports": len(ports),
        "genus": checks[SOLID].genus,
        "genus_expected": construct_genus(context.network, ports, body_genus(context)),
        "files": {name: asdict(check) for name, check in checks.items()},
    }
    return summary, NAMES


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
