"""Stage 4: lumens and construct as watertight solids, validated on the files read back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from design.solids import surface_genus, validate_files
from kernels import keep_freed_memory
from kernels.arrays import IntArray
from printctl.pipeline.built_solids import built_solids
from printctl.pipeline.context import RunContext
from printctl.pipeline.solid_files import checkable, write_solids
from printctl.pipeline.solid_notes import ConstructDesign, handles_note, no_ports_note
from printctl.pipeline.stage import Stage
from printctl.progress import Report
from printctl.recipe.growth import NamedNetwork
from printctl.recipe.tissue import NetworkTissue
from printctl.run_folder.artefacts import NETWORK, SOLID, SURFACE


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Build, write, read back, check."""
    with keep_freed_memory():  # an organ's arrays are of a hundred MB, and follow each other
        return _work(context, report)


def _work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    heavy = context.recipe.solid.heavy_facets(context.network.vessel_count)
    if heavy:
        context.bars.remark("solid", heavy)
    built = built_solids(context)
    report(0.6, "writing")
    names, steps = write_solids(context, built)
    report(0.8, "reading back")
    made = [built.lumen, built.construct]
    checks = validate_files([context.folder / name for name in names if checkable(name)], made)
    for check in checks.values():
        check.require_valid()
        if check.crossing_faces:
            context.bars.remark("solid", f"{check.file}: {check.crossing_faces} faces cross others")
    notes = _notes(context, built.ports, (checks[SOLID].genus, built.genus))
    for note in notes:
        context.bars.remark("solid", note)
    summary = {
        "volume_mm3": built.construct.volume_mm3,
        "lumen_volume_mm3": built.lumen.volume_mm3,
        "faces": len(built.construct.faces),
        "watertight": True,
        "ports": len(built.ports),
        "fittings": built.fittings,
        "genus": checks[SOLID].genus,
        "genus_expected": built.genus,
        **({"notes": list(notes)} if notes else {}),
        "files": {name: asdict(check) for name, check in checks.items()},
    }
    if steps:
        summary["step"] = {name: asdict(check) for name, check in steps.items()}
    if built.chamber is not None:
        summary["chamber_genus"] = surface_genus(built.chamber.faces)[0]
    return summary, names


def _notes(context: RunContext, ports: IntArray, genus: tuple[int | None, int]) -> tuple[str, ...]:
    """Sentences on a construct without ports, and on handles (told, expected) that differ."""
    told, expected = genus
    wrong = None if told == expected else told
    if wrong is None and len(ports):
        return ()
    design = ConstructDesign(
        context.designed_network, context.tissue, ports, context.recipe.print_scale
    )
    boxed = isinstance(context.recipe.tissue, NetworkTissue)
    closed = () if len(ports) else (no_ports_note(design, boxed=boxed),)
    return closed if wrong is None else (*closed, handles_note(design, wrong, expected))


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
