"""`printctl lumens`: predict from any slicer's G-code how wide each designed lumen stays open."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from design.network import VesselNetwork
from design.solids import Solid
from printctl.checks.lumens import (
    FilamentCheck,
    LumenCheck,
    Writing,
    check_filaments,
    check_model,
    check_network,
    read_filaments,
    read_layers,
)
from printctl.cli import lumens_options as options
from printctl.cli.lumens_read import (
    InkOptions,
    is_embedded,
    place_of_filaments,
    place_of_layers,
    read_designed,
    read_part,
    writing_of,
)
from printctl.cli.lumens_table import lumen_lines
from printctl.cli.options import (
    JsonFlag,
    PrinterOption,
    messages,
    print_json,
    print_lines,
    read_gcode_file,
)
from printctl.errors import SafetyError, UsageError
from printctl.failures import error_facts

Found = tuple[LumenCheck | FilamentCheck, np.ndarray]


def lumens(
    file: options.FileArg,
    network: options.NetworkOption = None,
    model: options.ModelOption = None,
    unit: options.UnitOption = None,
    syringe: options.SyringeOption = None,
    ink: options.InkOption = None,
    needle: options.NeedleOption = None,
    flow_ul_s: options.FlowOption = None,
    filament_mm: options.FilamentOption = None,
    line_um: options.LineOption = None,
    layer_um: options.LayerOption = None,
    embedded: options.EmbeddedFlag = False,
    place: options.PlaceOption = None,
    printer: PrinterOption = "generic_marlin",
    leak_um: options.LeakOption = 50.0,
    every: options.AllFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """Predict how open each lumen will be: diameter, conductance, closed layers, leaks.

    Of layers what they leave open; of an embedded print what its filaments make open. Ends with
    exit code 3 when a lumen is closed or leaks.
    """
    ink_options = InkOptions(
        printer, syringe, ink, needle, flow_ul_s, filament_mm, line_um, layer_um
    )
    writing, gcode = writing_of(ink_options), read_gcode_file(file)
    designed = None if network is None else read_designed(network, unit)
    part = read_part(model, network, unit)
    if designed is None and part is None:
        raise UsageError("nothing says where lumens should be; give --network or --model")
    if embedded or (designed is not None and is_embedded(file, gcode, writing)):
        check = _filaments(gcode, writing, designed, place, leak_um * 1e-3)
    else:
        check = _layers(gcode, writing, designed, part, place, leak_um * 1e-3)
    _show(check, file, every, as_json)


def _layers(
    gcode: bytes,
    writing: Writing,
    designed: VesselNetwork | None,
    part: Solid | None,
    place: str | None,
    leak_mm: float,
) -> Found:
    lines, stepped = read_layers(gcode, writing)
    at = place_of_layers(place, lines, part)
    if designed is not None:
        return check_network(lines, designed, at, stepped, leak_mm), at
    if part is None:
        raise UsageError("nothing says where lumens should be; give --network or --model")
    return check_model(lines, part, at, stepped, leak_mm), at


def _filaments(
    gcode: bytes,
    writing: Writing,
    designed: VesselNetwork | None,
    place: str | None,
    leak_mm: float,
) -> Found:
    if designed is None:
        raise UsageError(
            "--embedded: a model's holes don't say along which axes filaments should lie; give "
            "--network"
        )
    if writing.line_mm is not None:
        raise UsageError("--line-um is for layers; of filaments say what E means (--syringe)")
    ideal, stepped = read_filaments(gcode, writing)
    at = place_of_filaments(place, ideal, designed)
    return check_filaments(ideal, stepped, designed, at, leak_mm), at


def _show(checked: Found, file: Path, every: bool, as_json: bool) -> None:
    check, at = checked
    facts = {"file": str(file), "place_mm": at.tolist(), **check.as_dict()}
    refusal = None if check.refusal is None else SafetyError(check.refusal)
    if as_json:
        print_json(facts | (error_facts(refusal, str(refusal), 3) if refusal else {}))
    else:
        print_lines(*lumen_lines(facts, every))
        for note in facts["notes"]:
            messages().print(f"note: {note}", markup=False)
    if refusal is not None:
        raise refusal
