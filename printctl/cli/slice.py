"""`printctl slice`: FRESH layers of any closed mesh, without a recipe."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from design.files import write_bytes
from design.solids import Solid, read_solid
from design.toolpath.fresh import FreshOptions, FreshReport, Infill, plan_fresh
from design.toolpath.gcode import GcodeOptions, clear_mm, least_move_mm, write_gcode
from design.units import LengthUnit
from firmware_profiles import Ink, Printer, Syringe, load
from printctl.cli.options import JsonFlag, PrinterOption, SyringeOption, print_json, print_lines
from printctl.errors import UsageError


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
    layer_um: Annotated[float, typer.Option("--layer-um", min=5, max=2000)] = 60.0,
    line_um: Annotated[float, typer.Option("--line-um", min=10, max=5000)] = 150.0,
    walls: Annotated[int, typer.Option("--walls", min=1, max=50)] = 2,
    infill: Annotated[Infill, typer.Option("--infill")] = "lines",
    infill_percent: Annotated[float, typer.Option("--infill-percent", min=0, max=100)] = 100.0,
    speed: Annotated[float, typer.Option("--speed", help="Writing, mm/s.", min=0.01)] = 20.0,
    as_json: JsonFlag = False,
) -> None:
    """Slice a mesh into FRESH layers whose lumens keep their size, and write G-code.

    The part's middle comes to the middle of the work area, its lowest point to the lowest z. The
    job says where the tip stands when it begins: above the part's middle, clear of it.
    """
    if out.is_dir():
        raise UsageError(f"{out} is a folder; give the name of a .gcode file in it")
    profile, dose = load(Printer, printer), load(Ink, ink)
    solid = read_solid(model, unit)
    place, start = _placed(solid, profile)
    options = FreshOptions(
        layer_height_mm=layer_um * 1e-3,
        line_width_mm=line_um * 1e-3,
        walls=walls,
        infill=infill,
        infill_density=infill_percent * 1e-2,
        write_speed_mm_s=speed,
        retract_ul=dose.retract_ul,
        plunger_ul_s=dose.plunger_ul_s,
        least_move_mm=least_move_mm(profile),
        clear_mm=clear_mm(profile),
    )
    plan = plan_fresh(solid, options)
    gcode = write_gcode(
        plan.toolpath,
        profile,
        load(Syringe, syringe),
        place,
        GcodeOptions(
            start_mm=(float(start[0]), float(start[1]), float(start[2])),
            relieve_ul=dose.retract_ul,
            plunger_ul_s=dose.plunger_ul_s,
            flow_factor=dose.flow_factor,
        ),
    )
    write_bytes(out, gcode.data)
    facts = _facts(plan.report, gcode.line_count, out, place)
    if as_json:
        print_json(facts)
        return
    print_lines(
        f"{facts['layers']} layers, {facts['lines']} lines of G-code, "
        f"{facts['written_ul']:.4g} µL, {facts['unfilled_percent']:.2f} % of the part unfilled",
        str(out),
    )


def _placed(solid: Solid, printer: Printer) -> tuple[np.ndarray, np.ndarray]:
    """Where the part's origin comes to in the printer's frame, and where the tip begins, mm."""
    low, high = solid.bounds
    middle = [(span.low + span.high) / 2 for span in (printer.x_mm, printer.y_mm)]
    place = np.round(np.append(middle - (low + high)[:2] / 2, printer.z_mm.low - low[2]), 3)
    top = min(float(high[2] + place[2]) + 5.0, printer.z_mm.high)
    return place, np.round(np.append((low + high)[:2] / 2 + place[:2], top), 3)


def _facts(report: FreshReport, lines: int, out: Path, place: np.ndarray) -> dict[str, Any]:
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
