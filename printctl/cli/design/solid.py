"""`printctl solid`: a network's lumens as meshes; `printctl convert`: networks in other formats."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from design.solids import lumen_solid, tube_solid, validate_file, write_step
from design.solids.files.read import SUFFIXES
from printctl.analysis.flow.conditions import recipe_of
from printctl.analysis.networks import LOSSES, check_target, load_source, read_noted, write_network
from printctl.cli import options as cli
from printctl.cli.declare import json_command
from printctl.errors import UsageError
from printctl.pipeline.prepared.solid_build import WRITERS
from printctl.recipe.sections.solid import SolidPart
from printctl.settings import arg, of, opt


@json_command
def solid(
    source: cli.SourceArg,
    out: Path = opt("A .stl, .3mf, .step, .ply, .obj or .vtp file.", ...),
    unit: cli.UnitOption = None,
    fillet_ratio: float | None = of(
        SolidPart, "fillet_ratio", default=None, otherwise="0, or the run's own"
    ),
    wall_mm: float | None = opt("Tubes of this wall, not the lumens.", min=1e-3, max=50),
) -> None:
    """Make a solid of a vessel network, and read the file back to check it.

    STEP holds exact cylinders, cones and balls with sharp seams; it needs the extra "step".
    """
    kind = out.suffix.lower().removeprefix(".")
    if kind != "step" and kind not in WRITERS:
        raise UsageError(f"{out}: give a file that ends in .step, .{', .'.join(WRITERS)}")
    if kind == "step" and (fillet_ratio or wall_mm is not None):
        raise UsageError("--fillet-ratio and --wall-mm are for triangles; STEP has sharp lumens")
    cli.refuse_input_as_output(out, source)
    read = load_source(source, unit, None)
    network = read.network
    cli.print_dim(read.notes)
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
        if f".{kind}" in SUFFIXES:
            check = validate_file(out)
            check.require_valid()
            facts = asdict(check)
    crossing = facts.get("crossing_faces", 0)
    shown = f"{out}: {facts['volume']:.6g} mm³, {facts['faces']} faces"
    shown += f", {crossing} of which cross others" if crossing else ""
    cli.print_result(facts, [shown])


@json_command
def convert(
    source: Path = arg("Network: .csv, .vtp, .swc, .json, .npz, or X-CAVATE's .txt."),
    target: Path = arg(
        "The same formats but .txt; without a suffix a new folder of SimVascular paths."
    ),
    unit: cli.UnitOption = None,
    ends: Path | None = opt(
        "Inlets and outlets that come with X-CAVATE's .txt.", None, "--inlet-outlet"
    ),
) -> None:
    """Convert a vessel network between CSV, VTP, SWC, JSON and npz, and to SimVascular paths.

    X-CAVATE's networks (.txt, in cm unless --unit says otherwise) are read, and their vessels
    joined. All our files are in mm, but for SWC (µm) and SimVascular's (cm). An old file
    is replaced only by a whole new one.
    """
    check_target(target)
    cli.refuse_input_as_output(target, source)
    network, notes = read_noted(source, unit, ends)
    write_network(target, network)
    loss = LOSSES.get(target.suffix.lower())
    facts = {"file": str(target), "vessels": network.vessel_count, "loses": loss}
    cli.print_dim([*notes, loss] if loss else notes)
    made = f"{target}: {network.vessel_count} vessels, {len(network.points)} points"
    cli.print_result(facts | {"notes": list(notes)}, [made])
