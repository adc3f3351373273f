"""`printctl solid`: export a network's lumens, or tubes around them, as mesh or STEP."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from design.solids import lumen_solid, tube_solid, validate_file, write_step
from design.solids.read import SUFFIXES
from printctl.analysis.flow.conditions import recipe_of
from printctl.analysis.networks import load_source
from printctl.cli.network_options import SourceArg, UnitOption
from printctl.cli.options import (
    JsonFlag,
    messages,
    print_json,
    print_lines,
    refuse_input_as_output,
)
from printctl.errors import UsageError
from printctl.pipeline.solid_build import WRITERS


def solid(
    source: SourceArg,
    out: Annotated[
        Path,
        typer.Option(
            "--out", help="A .stl, .3mf, .step, .ply, .obj or .vtp file.", show_default=False
        ),
    ],
    unit: UnitOption = None,
    fillet_ratio: Annotated[
        float | None,
        typer.Option(
            "--fillet-ratio",
            min=0,
            max=1,
            help="Of junctions, over their thinnest vessel; 0, or the run's own.",
        ),
    ] = None,
    wall_mm: Annotated[
        float | None,
        typer.Option("--wall-mm", min=1e-3, max=50, help="Tubes of this wall, not the lumens."),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Make a solid of a vessel network, and read the file back to check it.

    STEP holds exact cylinders, cones and balls with sharp seams; it needs the extra "step".
    """
    kind = out.suffix.lower().removeprefix(".")
    if kind != "step" and kind not in WRITERS:
        raise UsageError(f"{out}: give a file that ends in .step, .{', .'.join(WRITERS)}")
    if kind == "step" and (fillet_ratio or wall_mm is not None):
        raise UsageError("--fillet-ratio and --wall-mm are for triangles; STEP has sharp lumens")
    refuse_input_as_output(out, source)
    read = load_source(source, unit, None)
    network = read.network
    for note in read.notes:
        messages().print(note, style="dim", markup=False)
    if fillet_ratio is None:
        own = source.is_dir() and kind != "step"
        fillet_ratio = recipe_of(source, "solid of a run").solid.fillet_ratio if own else 0.0
    if kind == "step":
        facts = asdict(write_step(out, network))
    else:
        if wall_mm is None:
            made = lumen_solid(network, fillet_ratio=fillet_ratio)
        else:
            made = tube_solid(network, wall_mm, fillet_ratio=fillet_ratio)
        WRITERS[kind](out, made)
        facts = {"file": out.name, "volume": made.volume_mm3, "faces": len(made.faces)}
        if out.suffix.lower() in SUFFIXES:
            check = validate_file(out)
            check.require_valid()
            facts = asdict(check)
    if as_json:
        print_json(facts)
        return
    shown = f"{out}: {facts['volume']:.6g} mm³, {facts['faces']} faces"
    crossing = facts.get("crossing_faces", 0)
    print_lines(shown + (f", {crossing} of which cross others" if crossing else ""))
