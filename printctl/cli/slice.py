"""`printctl slice`: FRESH layers of any closed mesh, without a recipe."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from design.solids import Solid, read_solid
from design.toolpath.fresh import Filling, FreshLayers, FreshOptions, FreshReport, Infill
from design.toolpath.gcode import (
    GcodeOptions,
    clear_mm,
    joint_mm,
    least_move_mm,
    save_gcode,
    stream_gcode,
)
from design.units import LengthUnit
from firmware_profiles import Ink, Needle, Printer, Syringe, load, steady_flow
from printctl.cli.options import (
    JsonFlag,
    PrinterOption,
    SyringeOption,
    messages,
    print_json,
    print_lines,
)
from printctl.errors import UsageError
from printctl.pipeline.writer_options import gcode_options

#: Height of the tip above the part when the job begins, mm.
_ABOVE_MM = 5.0


def slice_mesh(
    model: Annotated[
        Path, typer.Argument(help="STL, 3MF, PLY, OBJ or OFF; closed.", show_default=False)
    ],
    out: Annotated[Path, typer.Option("--out", help="G-code file to write.", show_default=False)],
    unit: Annotated[
        LengthUnit | None, typer.Option("--unit", help="Of the mesh; a 3MF says it itself.")
    ] = None,
    printer: PrinterOption = "generic_marlin",
    syringe: SyringeOption = "hamilton_1ml",
    ink: Annotated[str, typer.Option("--ink", help="Ink profile.")] = "collagen_fresh",
    needle: Annotated[
        str, typer.Option("--needle", help="Needle profile; what a pneumatic head lays needs it.")
    ] = "fresh_150um",
    layer_um: Annotated[
        float, typer.Option("--layer-um", help="Height of a layer, µm.", min=5, max=2000)
    ] = 60.0,
    line_um: Annotated[
        float, typer.Option("--line-um", help="Width of a line, µm.", min=10, max=5000)
    ] = 150.0,
    walls: Annotated[int, typer.Option("--walls", help="Along every boundary.", min=1, max=50)] = 2,
    infill: Annotated[
        Infill, typer.Option("--infill", help="What fills the inside of the walls.")
    ] = "lines",
    infill_percent: Annotated[
        float,
        typer.Option(
            "--infill-percent", help="Share of the inside that is filled.", min=0, max=100
        ),
    ] = 100.0,
    speed: Annotated[float, typer.Option("--speed", help="Writing, mm/s.", min=0.01)] = 20.0,
    as_json: JsonFlag = False,
) -> None:
    """Slice a mesh into FRESH layers whose lumens keep their size; write G-code and its line map.

    The part's middle comes to the middle of the work area, its lowest point to the lowest z. The
    job says where the tip stands when it begins: above the part's middle, clear of it. Nothing is
    checked here: look at it with `printctl simulate`, and `printctl print` checks again.
    """
    if out.is_dir():
        raise UsageError(f"{out} is a folder; give the name of a .gcode file in it")
    profile, dose, barrel = load(Printer, printer), load(Ink, ink), load(Syringe, syringe)
    solid = read_solid(model, unit)
    _check_size(solid, profile, model)
    layers = FreshLayers(
        solid,
        FreshOptions(
            layer_height_mm=layer_um * 1e-3,
            line_width_mm=line_um * 1e-3,
            bead=dose.bead_section,
            walls=walls,
            filling=Filling(infill, infill_percent * 1e-2),
            write_speed_mm_s=speed,
            retract_ul=dose.retract_ul,
            plunger_ul_s=dose.plunger_ul_s,
            least_move_mm=least_move_mm(profile),
            clear_mm=clear_mm(profile),
            joint_mm=joint_mm(profile),
        ),
    )
    place, start = _placed(solid, profile)
    machine = (profile, barrel, place, _options(profile, dose, load(Needle, needle), start))
    lines = save_gcode(
        out, out.with_suffix(".map.npz"), stream_gcode(layers, *machine, layers.top_mm)
    )
    report = layers.report()
    if report.written_ul > barrel.volume_ul:
        messages().print(
            f"note: {report.written_ul:.4g} µL is more than {barrel.name} holds "
            f"({barrel.volume_ul:g} µL): it will be changed on the way (printctl reload)",
            markup=False,
        )
    _tell(_facts(report, lines, out, place), as_json)


def _check_size(solid: Solid, printer: Printer, model: Path) -> None:
    """Refuse what is larger than the machine before it is sliced: it may be the unit."""
    size = solid.bounds[1] - solid.bounds[0]
    for axis, mm in zip("xyz", size.tolist(), strict=True):
        span = getattr(printer, f"{axis}_mm")
        if mm > span.high - span.low:
            raise UsageError(
                f"{model} is {mm:g} mm long in {axis}, more than the {span.high - span.low:g} mm "
                f"of {printer.name}; check --unit"
            )


def _placed(
    solid: Solid, printer: Printer
) -> tuple[NDArray[np.float64], tuple[float, float, float]]:
    """Where the part's origin comes to in the printer's frame, and where the tip begins, mm."""
    low, high = solid.bounds
    middle = [(span.low + span.high) / 2 for span in (printer.x_mm, printer.y_mm)]
    place = np.round(np.append(middle - (low + high)[:2] / 2, printer.z_mm.low - low[2]), 3)
    top = min(float(high[2] + place[2]) + _ABOVE_MM, printer.z_mm.high)
    x, y = np.round((low + high)[:2] / 2 + place[:2], 3).tolist()
    return place, (x, y, round(top, 3))


def _options(
    printer: Printer, ink: Ink, needle: Needle, start: tuple[float, float, float]
) -> GcodeOptions:
    head = printer.pneumatic
    flow = None if head is None else steady_flow(head, ink, needle).ul_s
    return gcode_options(ink, start, FreshOptions.travel_speed_mm_s, flow)


def _facts(
    report: FreshReport, lines: int, out: Path, place: NDArray[np.float64]
) -> dict[str, Any]:
    return {
        "gcode": str(out),
        "layers": report.layers,
        "lines": lines,
        "written_ul": report.written_ul,
        "material_ul": report.material_ul,
        "unfilled_percent": 100 * report.unfilled_fraction,
        "travels": report.travels,
        "lifted": report.lifted,
        "place_mm": place.tolist(),
    }


def _tell(facts: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print_json(facts)
        return
    print_lines(
        f"{facts['layers']} layers, {facts['lines']} lines of G-code, "
        f"{facts['written_ul']:.4g} µL, {facts['unfilled_percent']:.2f} % of the part unfilled",
        facts["gcode"],
    )
