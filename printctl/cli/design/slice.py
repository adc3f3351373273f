"""`printctl slice`: slice closed meshes into FRESH layers, without a recipe."""

from __future__ import annotations

from pathlib import Path

from design.toolpath.fresh import Adaptive, Filling, FreshOptions, Infill
from design.units import LengthUnit
from firmware_profiles import Bath, Dish, Printer, load
from kernels import freed_memory_returned
from printctl.checks.line_width import bore_check
from printctl.checks.set_up import (
    ASSUMED,
    ProfileNames,
    loads_of,
    of_each,
    or_assumed,
    refuse_failed,
)
from printctl.cli.declare import json_command
from printctl.cli.kernels_ready import have_kernels
from printctl.cli.options import PrinterOption, gcode_to_write, print_notes, print_result
from printctl.errors import UsageError
from printctl.pipeline.job import slicing
from printctl.pipeline.job.modifiers import read_modifier
from printctl.recipe.sections.toolpath import Fresh
from printctl.settings import arg, of, opt, three_numbers

_LINES_UM = (10.0, 5000.0)
_NEEDLE = "fresh_150um"
_BATH = "gelatin_support"


@json_command
def slice_mesh(
    models: list[Path] = arg(
        "STL, 3MF, PLY, OBJ or OFF; closed. Several, in one frame: each by a head of its own; "
        "where two overlap the later one counts.",
        metavar="MESH...",
    ),
    out: Path = opt("G-code file to write.", ...),
    unit: LengthUnit | None = opt("Length unit of the meshes; a 3MF file contains it."),
    printer: PrinterOption = "generic_marlin",
    heads: str | None = opt("Head of each mesh, counted from 0, like 0,1,1; if not given 0,1,..."),
    syringe: str | None = opt(
        "Syringe profile; of several heads: left,right.", show_default=ASSUMED["syringe"]
    ),
    ink: str | None = opt(
        "Ink profile; of several heads: left,right.", show_default=ASSUMED["ink"]
    ),
    needle: str | None = opt(
        "Needle profile, of several heads: left,right; what a pneumatic head lays needs it.",
        show_default=_NEEDLE,
    ),
    thinnest_bore: float = of(ProfileNames, "thinnest_bore"),
    bath: str | None = opt(
        "Bath profile: its floor clearance is kept below the part.", show_default=_BATH
    ),
    dish: str | None = opt("Dish profile: several heads are changed above its wall."),
    place: str | None = opt(
        "Where the meshes' origin goes in the printer's frame, mm; by default the part is centred "
        "on the build plate, with its bottom at the bath's floor clearance.",
        metavar="X,Y,Z",
    ),
    layer_um: float = opt("Height of a layer, µm.", 60.0, min=5, max=2000),
    thinnest_um: float | None = of(Fresh, "thinnest_layer_um", "--thinnest-layer-um"),
    stair_um: float = of(Fresh, "stair_um"),
    line_um: str = opt("Width of a line, µm; of several heads: left,right.", "150"),
    walls: int = of(Fresh, "walls"),
    infill: Infill = of(Fresh, "infill"),
    infill_percent: float = of(Fresh, "infill_percent"),
    modifier: list[str] | None = opt(
        "Inside this mesh the part is filled in another way: infill, infill-percent, "
        "infill-angles (45/135), or written by another head. Again for each.",
        metavar="MESH:SETTING=VALUE,...",
    ),
    speed: float = of(Fresh, "write_speed_mm_s", "--speed", min=0.01),
) -> None:
    """Slice meshes into FRESH layers whose lumens keep their size; write G-code and its line map.

    The file says where the tip stands when it begins: above the middle of the part, clear of it.
    Check it with `printctl simulate`; `printctl print` checks it again.
    """
    gcode_to_write(out, *models)
    profile = load(Printer, printer)
    filling = Filling(infill, infill_percent * 1e-2)
    chosen = slicing.head_of_each(heads, len(models), profile)
    usual = ASSUMED | {"needle": _NEEDLE}
    parts, notes = or_assumed({"syringe": syringe, "ink": ink, "needle": needle}, usual)
    loads = loads_of(profile, parts["syringe"], parts["ink"], parts["needle"])
    widths = _lines_mm(profile, line_um)
    refuse_failed([
        bore_check(width, one.needle, thinnest_bore, "--line-um")
        for width, one in zip(widths, loads, strict=True)
        if one.needle is not None
    ])  # fmt: skip
    have_kernels("slice")
    modifiers = [read_modifier(text, profile.head_count) for text in modifier or ()]
    adaptive = None
    if thinnest_um is not None:  # Layers follow the slopes, in whole steps of the vertical motor.
        adaptive = Adaptive(thinnest_um * 1e-3, stair_um * 1e-3, 1 / profile.steps_per_mm.z)
    how = FreshOptions(
        layer_height_mm=layer_um * 1e-3,
        adaptive=adaptive,
        walls=walls,
        filling=filling,
        write_speed_mm_s=speed,
    )
    stands_in = None if dish is None else load(Dish, dish)
    filled = None if bath is None else load(Bath, bath)
    clearance_mm = (filled or load(Bath, _BATH)).floor_clearance_mm
    at = None if place is None else three_numbers(place, "--place")
    with freed_memory_returned():
        pieces = slicing.assemble(models, chosen, modifiers, filling, unit)
        job = slicing.SliceJob(
            pieces, profile, loads, widths, how, stands_in, clearance_mm, at, filled
        )
        written = slicing.slice_parts(job, out)
    print_notes([*notes, *slicing.job_notes(job, written)])
    facts = slicing.job_facts(job, written, models, out)
    low, high = facts["layer_um"]
    span = "" if high - low < 0.01 else f" of {low:.4g} to {high:.4g} µm"
    print_result(facts, [
        f"{facts['layers']} layers{span}, {facts['lines']} lines of G-code, "
        f"{facts['written_ul']:.4g} µL, {facts['unfilled_percent']:.2f} % of the part unfilled",
        *(
            f"head {one['head']} ({one['name']}, {one['ink']}): {one['written_ul']:.4g} µL"
            for one in facts.get("heads", ())
        ),
        facts["gcode"],
    ])  # fmt: skip


def _lines_mm(printer: Printer, text: str) -> tuple[float, ...]:
    """Width of each head's lines, mm."""
    low, high = _LINES_UM
    widths = []
    for word in of_each(printer, text, "--line-um"):
        try:
            width = float(word)
        except ValueError as exc:
            raise UsageError(f"--line-um {text!r}: {word!r} isn't a number of µm") from exc
        if not low <= width <= high:
            raise UsageError(f"--line-um {width:g} lies outside {low:g} to {high:g} µm")
        widths.append(width * 1e-3)
    return tuple(widths)
