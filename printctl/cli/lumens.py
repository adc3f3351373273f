"""`printctl lumens`: how open each lumen will be, from the G-code of any slicer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from design.network import VesselNetwork
from design.solids import Solid, read_solid
from design.units import LengthUnit
from firmware_profiles import Ink, Printer, Syringe, load
from printctl.cli.lumens_table import lumen_lines
from printctl.cli.options import (
    JsonFlag,
    PrinterOption,
    messages,
    print_json,
    print_lines,
    read_gcode_file,
    three_numbers,
)
from printctl.errors import SafetyError, UsageError
from printctl.lumens import (
    LumenCheck,
    WrittenLines,
    check_model,
    check_network,
    find_place,
    read_lines,
)
from printctl.networks.formats import read_network
from printctl.pipeline.context import NETWORK
from printctl.pipeline.manifest import MANIFEST
from printctl.pipeline.stages.tissue import SURFACE


def lumens(
    file: Annotated[Path, typer.Argument(help="The G-code file.", show_default=False)],
    network: Annotated[
        Path | None,
        typer.Option("--network", help="The designed vessels: a network's file or a run folder."),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model", help="The part as a closed mesh; without a network its holes are the lumens."
        ),
    ] = None,
    unit: Annotated[
        LengthUnit | None,
        typer.Option("--unit", help="Of the network's and the model's files, if they don't say."),
    ] = None,
    syringe: Annotated[
        str | None, typer.Option("--syringe", help="E is the plunger's travel in this syringe.")
    ] = None,
    ink: Annotated[
        str | None,
        typer.Option("--ink", help="Whose flow factor (out over pushed) the file was made for."),
    ] = None,
    filament_mm: Annotated[
        float | None,
        typer.Option("--filament-mm", min=0.05, max=20, help="E is the way of such a filament."),
    ] = None,
    line_um: Annotated[
        float | None,
        typer.Option("--line-um", min=5, max=10_000, help="All lines are so wide, whatever E is."),
    ] = None,
    layer_um: Annotated[
        float | None,
        typer.Option("--layer-um", min=1, max=5000, help="Of a file with one layer."),
    ] = None,
    rounded: Annotated[
        bool,
        typer.Option("--rounded", help="Lines have round sides, as slicers for plastic plan them."),
    ] = False,
    place: Annotated[
        str | None,
        typer.Option(
            "--place", metavar="X,Y,Z", help="The part's origin in the printer's frame, mm."
        ),
    ] = None,
    printer: PrinterOption = "generic_marlin",
    leak_um: Annotated[
        float, typer.Option("--leak-um", min=10, max=2000, help="Narrower ways are no leaks.")
    ] = 50.0,
    every: Annotated[bool, typer.Option("--all", help="A row for every lumen.")] = False,
    as_json: JsonFlag = False,
) -> None:
    """Predict how open each lumen will be: diameter, conductance, closed layers, leaks.

    Ends with exit code 3 when a lumen is closed or leaks.
    """
    area = _area(syringe, filament_mm, line_um, ink)
    steps = load(Printer, printer).steps_per_mm
    gcode = read_gcode_file(file)
    designed = None if network is None else _network(network, unit)
    part = _part(model, network, unit)
    wanted = designed if designed is not None else part
    if wanted is None:
        raise UsageError("nothing says where lumens should be; give --network or --model")
    lines = read_lines(
        gcode,
        area,
        line_mm=None if line_um is None else line_um * 1e-3,
        layer_mm=None if layer_um is None else layer_um * 1e-3,
        rounded=rounded,
    )
    at = _place(place, lines, part)
    per_mm, leak_mm = (steps.x, steps.y), leak_um * 1e-3
    if isinstance(wanted, VesselNetwork):
        check = check_network(lines, wanted, at, per_mm, leak_mm)
    else:
        check = check_model(lines, wanted, at, per_mm, leak_mm)
    _show(check, file, at, every, as_json)


def _area(
    syringe: str | None, filament_mm: float | None, line_um: float | None, ink: str | None
) -> float | None:
    """Volume of one E, µL/mm; None where line widths are given."""
    if sum(value is not None for value in (syringe, filament_mm, line_um)) != 1:
        raise UsageError(
            "what E means must be said once: --syringe NAME (the plunger's travel), "
            "--filament-mm D (PrusaSlicer and others, often 1.75), or --line-um W"
        )
    bore = load(Syringe, syringe).inner_mm if syringe is not None else filament_mm
    factor = load(Ink, ink).flow_factor if ink is not None else 1.0
    return None if bore is None else np.pi / 4 * bore**2 * factor


def _network(path: Path, unit: LengthUnit | None) -> VesselNetwork:
    """The network; in a run folder all files are in mm."""
    if path.is_dir():
        path = path / NETWORK
    if unit is None and (path.parent / MANIFEST).is_file() and path.name == NETWORK:
        unit = "mm"
    return read_network(path, unit)


def _part(model: Path | None, network: Path | None, unit: LengthUnit | None) -> Solid | None:
    """The model; of a network in a run folder, the tissue."""
    if model is not None:
        return read_solid(model, unit)
    folder = network if network is None or network.is_dir() else network.parent
    if folder is not None and (folder / MANIFEST).is_file() and (folder / SURFACE).is_file():
        return read_solid(folder / SURFACE, "mm")
    return None


def _place(text: str | None, lines: WrittenLines, part: Solid | None) -> np.ndarray:
    if text is not None:
        return np.array(three_numbers(text, "--place"))
    if part is None:
        raise UsageError(
            "where the part stands isn't known: a network alone has no outside to compare with "
            "the ink; give --place X,Y,Z (the part's origin in the printer's frame) or --model"
        )
    return find_place(lines, part)


def _show(check: LumenCheck, file: Path, at: np.ndarray, every: bool, as_json: bool) -> None:
    found = {"file": str(file), "place_mm": at.tolist(), **check.as_dict()}
    if as_json:
        print_json(found)
    else:
        print_lines(*lumen_lines(found, every))
        for note in found["notes"]:
            messages().print(f"note: {note}", markup=False)
    if check.refusal is not None:
        raise SafetyError(check.refusal)
