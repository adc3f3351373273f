"""`printctl slice`: slice closed meshes into FRESH layers, without a recipe."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from design.toolpath.fresh import Adaptive, Filling, FreshOptions, Infill
from design.units import LengthUnit
from firmware_profiles import Dish, Printer, load
from firmware_profiles.tools import THINNEST_BORE
from kernels import freed_memory_returned
from printctl.checks.preflight.bore import bore_check
from printctl.checks.set_up import loads_of, of_each, refuse_failed
from printctl.cli.declare import command
from printctl.cli.kernels_ready import have_kernels
from printctl.cli.options import (
    JsonFlag,
    PrinterOption,
    ThinnestBoreOption,
    messages,
    print_json,
    print_lines,
    refuse_input_as_output,
)
from printctl.errors import UsageError
from printctl.pipeline.slicing import (
    JobFigures,
    SliceJob,
    assemble,
    head_of_each,
    read_modifier,
    slice_parts,
)
from printctl.settings import arg, opt

# Typer option types of `printctl slice`: meshes, heads, profiles, layers, lines, infill, speed.

_HEIGHT_PART = 0.01
"""Of the part's height: what layers may be off by before it is told."""
_LINES_UM = (10.0, 5000.0)


@command
def slice_mesh(
    models: list[Path] = arg(
        "STL, 3MF, PLY, OBJ or OFF; closed. Several, in one frame: each by a head of its own; "
        "where two overlap the later one counts.",
        metavar="MESH...",
    ),
    out: Path = opt("G-code file to write.", ...),
    unit: LengthUnit | None = opt("Of the meshes; a 3MF says it itself."),
    printer: PrinterOption = "generic_marlin",
    heads: str | None = opt("Head of each mesh, counted from 0, like 0,1,1; if not given 0,1,..."),
    syringe: str = opt("Syringe profile; of several heads: left,right.", "hamilton_1ml"),
    ink: str = opt("Ink profile; of several heads: left,right.", "collagen_fresh"),
    needle: str = opt(
        "Needle profile, of several heads: left,right; what a pneumatic head lays needs it.",
        "fresh_150um",
    ),
    thinnest_bore: ThinnestBoreOption = THINNEST_BORE,
    dish: str | None = opt("Dish profile: several heads are changed above its wall."),
    layer_um: float = opt("Height of a layer, µm.", 60.0, min=5, max=2000),
    thinnest_um: float | None = opt(
        "Layers down to this height where walls are slanted, µm; all alike if not given.",
        None,
        "--thinnest-layer-um",
        min=5,
        max=2000,
    ),
    stair_um: float = opt(
        "With --thinnest-layer-um: depth of a slanted wall's stair from which on layers become "
        "thinner, µm.",
        20.0,
        min=1,
        max=500,
    ),
    line_um: str = opt("Width of a line, µm; of several heads: left,right.", "150"),
    walls: int = opt("Along every boundary.", 2, min=1, max=50),
    infill: Infill = opt("What fills the inside of the walls.", "lines"),
    infill_percent: float = opt("Share of the inside that is filled.", 100.0, min=0, max=100),
    modifier: list[str] | None = opt(
        "Inside this mesh the part is filled in another way: infill, infill-percent, "
        "infill-angles (45/135), or written by another head. Again for each.",
        metavar="MESH:SETTING=VALUE,...",
    ),
    speed: float = opt("Writing, mm/s.", 20.0, min=0.01),
    as_json: JsonFlag = False,
) -> None:
    """Slice meshes into FRESH layers whose lumens keep their size; write G-code and its line map.

    The part's middle comes to the middle of what every tip reaches, its lowest point to the lowest
    z. The job says where the tip stands when it begins: above the part's middle, clear of it.
    Nothing is checked here: look at it with `printctl simulate`, and `printctl print` checks again.
    """
    if out.is_dir():
        raise UsageError(f"{out} is a folder; give the name of a .gcode file in it")
    refuse_input_as_output(out, *models)
    profile = load(Printer, printer)
    filling = Filling(infill, infill_percent * 1e-2)
    chosen = head_of_each(heads, len(models), profile)
    loads, widths = loads_of(profile, syringe, ink, needle), _lines_mm(profile, line_um)
    refuse_failed(
        [
            bore_check(width, one.needle, thinnest_bore, "--line-um")
            for width, one in zip(widths, loads, strict=True)
            if one.needle is not None
        ]
    )
    have_kernels("slice")
    modifiers = [read_modifier(text, profile.head_count) for text in modifier or ()]
    with freed_memory_returned():
        job = SliceJob(
            assemble(models, chosen, modifiers, filling, unit),
            profile,
            loads,
            widths,
            FreshOptions(
                layer_height_mm=layer_um * 1e-3,
                adaptive=_adaptive(profile, thinnest_um, stair_um),
                walls=walls,
                filling=filling,
                write_speed_mm_s=speed,
            ),
            None if dish is None else load(Dish, dish),
        )
        written = slice_parts(job, out)
    for note in _notes(job, written):
        messages().print(f"note: {note}", markup=False)
    _tell(_facts(job, written, models, out), as_json)


def _adaptive(printer: Printer, thinnest_um: float | None, stair_um: float) -> Adaptive | None:
    """Layers that follow the slopes, in whole steps of the vertical motor."""
    if thinnest_um is None:
        return None
    return Adaptive(thinnest_um * 1e-3, stair_um * 1e-3, 1 / printer.steps_per_mm.z)


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


def _notes(job: SliceJob, written: JobFigures) -> list[str]:
    """What a person should know before printing."""
    notes = [note for solid in job.parts.solids for note in solid.notes]
    notes += [*_height_note(written), *written.report.narrow_notes]
    for number, ul in enumerate(written.report.written_ul_of_heads):
        barrel = job.loads[number].syringe
        if ul > barrel.volume_ul:
            notes.append(
                f"{ul:.4g} µL is more than {barrel.name} holds ({barrel.volume_ul:g} µL)"
                f"{f' in head {number}' if job.printer.heads else ''}: it will be changed on the "
                "way (printctl reload)"
            )
    if written.report.changes and job.dish is None:
        notes.append(
            "heads are changed 5 mm above the part, wherever the dish's wall ends; give --dish to "
            "have them changed above it"
        )
    return notes


def _height_note(written: JobFigures) -> list[str]:
    """Say where whole layers make the part more than a hundredth higher or lower."""
    off = written.height_mm - written.part_mm
    if abs(off) <= _HEIGHT_PART * written.part_mm:
        return []
    return [
        f"the part is {written.part_mm:.4g} mm high and its {written.report.layers} layers "
        f"{written.height_mm:.4g} mm: {abs(off):.2g} mm {'more' if off > 0 else 'less'} than "
        "designed; choose --layer-um so that whole layers fill it"
    ]


def _facts(job: SliceJob, written: JobFigures, models: list[Path], out: Path) -> dict[str, Any]:
    report = written.report
    facts = {
        "gcode": str(out),
        "layers": report.layers,
        "layer_um": [1e3 * height for height in written.heights_mm],
        "lines": written.lines,
        "written_ul": report.written_ul,
        "part_ul": report.part_ul,
        "material_ul": report.material_ul,
        "unfilled_percent": 100 * report.unfilled_fraction,
        **{
            name: None if places is None else asdict(places)
            for name, places in (
                ("thin_walls", report.thin_walls or report.low_walls),
                ("narrow_gaps", report.narrow_gaps or report.low_gaps),
            )
        },
        "travels": report.travels,
        "lifted": report.lifted,
        "place_mm": written.place_mm.tolist(),
    }
    if not job.printer.heads:
        return facts
    facts["meshes"] = [
        {"file": str(model), "head": head}
        for model, head in zip(models, job.parts.heads, strict=True)
    ]
    facts["changes"] = report.changes
    facts["heads"] = [
        {"head": number, "name": one.name, "ink": job.loads[number].ink.name, "written_ul": ul}
        for number, (one, ul) in enumerate(
            zip(job.printer.heads, _of_each_head(job, report.written_ul_of_heads), strict=True)
        )
    ]
    return facts


def _of_each_head(job: SliceJob, written: tuple[float, ...]) -> tuple[float, ...]:
    return written + (0.0,) * (job.printer.head_count - len(written))


def _tell(facts: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print_json(facts)
        return
    print_lines(
        f"{facts['layers']} layers{_span(facts['layer_um'])}, {facts['lines']} lines of G-code, "
        f"{facts['written_ul']:.4g} µL, {facts['unfilled_percent']:.2f} % of the part unfilled",
        *(
            f"head {one['head']} ({one['name']}, {one['ink']}): {one['written_ul']:.4g} µL"
            for one in facts.get("heads", ())
        ),
        facts["gcode"],
    )


def _span(heights_um: list[float]) -> str:
    low, high = heights_um
    return "" if high - low < 0.01 else f" of {low:.4g} to {high:.4g} µm"
