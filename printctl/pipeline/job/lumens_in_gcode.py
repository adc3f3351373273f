"""Check the lumens that a G-code file will leave open: what the user asks, and the answer."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from design.network import VesselNetwork
from design.solids import Solid, read_solid
from design.units import LengthUnit
from firmware_profiles import Ink, Needle, Printer, Syringe, load, steady_flow
from firmware_profiles.materials.bead import BeadSection
from gcode.deposit.written import Strands
from printctl.analysis.meshes import read_model
from printctl.analysis.networks import read_noted
from printctl.checks.gcode_view import read_line_map
from printctl.checks.gcode_view.levels import is_flat
from printctl.checks.lumens import (
    FilamentCheck,
    LumenCheck,
    Writing,
    WrittenLines,
    check_filaments,
    check_model,
    check_network,
    find_filament_place,
    find_place,
    read_filaments,
    read_layers,
    writes_at,
)
from printctl.checks.set_up import of_each
from printctl.errors import UsageError
from printctl.run_folder.artefacts import NETWORK, SURFACE
from printctl.run_folder.manifest import MANIFEST
from printctl.settings import opt, settings

Place = tuple[float, float, float]
Say = Callable[[str], None]
Found = tuple[LumenCheck | FilamentCheck, np.ndarray]


@settings
class LumenQuestion:
    """Where lumens should be, and how the file's moves become ink; None is left open."""

    network: Path | None = opt("The designed vessels: a network's file or a run folder.")
    model: Path | None = opt(
        "The part as a closed mesh; without a network its holes are the lumens."
    )
    unit: LengthUnit | None = opt("Of the network's and the model's files, if they don't say.")
    syringe: str | None = opt(
        "E is the plunger's travel in this syringe; of several heads: left,right."
    )
    ink: str | None = opt(
        "Whose flow factor (out over pushed) the file was made for, and whose bead lines have "
        "(without one: rounded); of a pneumatic head, what flows."
    )
    needle: str | None = opt("Of a pneumatic head: through which the ink flows.")
    flow_ul_s: float | None = opt("Of a pneumatic head while its valve is open.", min=1e-9)
    filament_mm: float | None = opt("E is the way of such a filament.", min=0.05, max=20)
    line_um: float | None = opt("All lines are so wide, whatever E is.", min=5, max=10_000)
    layer_um: float | None = opt("Of a file with one layer.", min=1, max=5000)
    embedded: bool | None = opt(
        "Filaments along the vessels, or layers; as FILE.map.npz says by default. Without a map, "
        "level writing is taken as layers.",
        None,
        "--embedded/--layered",
    )
    printer: str = opt("Printer profile: a shipped name or a .yaml file.", "generic_marlin")
    leak_um: float = opt("Narrower ways are no leaks.", 50.0, min=10, max=2000)


def check_lumens(
    file: Path, gcode: bytes, requested: LumenQuestion, place: Place | None, say: Say
) -> Found:
    """Check what the file's layers or filaments leave open.

    Parameters
    ----------
    file : Path
        Its map of lines, FILE.map.npz, may stand beside it.
    gcode : bytes
    asked : LumenQuestion
    place : (x, y, z) or None, mm
        The part's origin in the printer's frame; found from what is written where not given.
    say : callable
        Gets what the user should know of the files read.

    Returns
    -------
    check : LumenCheck or FilamentCheck
    place : (3,) float64, mm

    Raises
    ------
    UsageError
        When a question is open, or answered twice.
    """
    writing = writing_of(requested)
    designed = (
        None if requested.network is None else read_designed(requested.network, requested.unit, say)
    )
    part = read_part(requested.model, requested.network, requested.unit, say)
    if designed is None and part is None:
        raise UsageError("nothing says where lumens should be; give --network or --model")
    leak_mm = requested.leak_um * 1e-3
    embedded = requested.embedded
    if embedded is None:
        embedded = designed is not None and is_embedded(file, gcode, writing, say)
    if embedded:
        return _filaments(gcode, writing, designed, place, leak_mm)
    return _layers(gcode, writing, designed, part, place, leak_mm)


def _layers(
    gcode: bytes,
    writing: Writing,
    designed: VesselNetwork | None,
    part: Solid | None,
    place: Place | None,
    leak_mm: float,
) -> Found:
    lines, stepped = read_layers(gcode, writing)
    at = _place_of_layers(place, lines, part)
    if designed is not None:
        return check_network(lines, designed, at, stepped, leak_mm), at
    if part is None:
        raise UsageError("nothing says where lumens should be; give --network or --model")
    return check_model(lines, part, at, stepped, leak_mm), at


def _filaments(
    gcode: bytes,
    writing: Writing,
    designed: VesselNetwork | None,
    place: Place | None,
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


def writing_of(options: LumenQuestion) -> Writing:
    """How the file's moves become ink.

    Raises
    ------
    UsageError
        When that isn't said, or twice.
    """
    printer = load(Printer, options.printer)
    layer_mm = None if options.layer_um is None else options.layer_um * 1e-3
    inks = (
        None
        if options.ink is None
        else [load(Ink, n) for n in of_each(printer, options.ink, "--ink")]
    )
    beads = (BeadSection(),) if inks is None else tuple(ink.bead_section for ink in inks)
    if printer.pneumatic is not None:
        flow = _flow(options, printer)
        return Writing(printer, flow_ul_s=flow, layer_mm=layer_mm, beads=beads)
    if options.flow_ul_s is not None:
        raise UsageError(
            f"--flow-ul-s: {printer.name} has a plunger, whose E says what flows; name a printer "
            "with a pneumatic head (--printer)"
        )
    areas = _areas(options, printer, inks)
    return Writing(
        printer,
        None if areas is None else areas[0],
        line_mm=None if options.line_um is None else options.line_um * 1e-3,
        layer_mm=layer_mm,
        beads=beads,
        ul_per_e_of_heads=tuple(areas or ()) if printer.heads else (),
    )


def _flow(options: LumenQuestion, printer: Printer) -> float:
    head = printer.pneumatic
    for option, value in (
        ("--syringe", options.syringe),
        ("--filament-mm", options.filament_mm),
        ("--line-um", options.line_um),
    ):
        if value is not None:
            raise UsageError(f"{option}: {printer.name} has no plunger; give --flow-ul-s")
    if options.flow_ul_s is not None:
        return options.flow_ul_s
    if head is None or options.ink is None or options.needle is None:
        raise UsageError(
            f"what flows while the valve of {printer.name} is open must be said: --flow-ul-s, or "
            "--ink and --needle (the profile's pressure then foresees it)"
        )
    return steady_flow(head, load(Ink, options.ink), load(Needle, options.needle)).ul_s


def _areas(options: LumenQuestion, printer: Printer, inks: list[Ink] | None) -> list[float] | None:
    """Volume of one E of each head, µL/mm; None where line widths are given."""
    if (
        sum(value is not None for value in (options.syringe, options.filament_mm, options.line_um))
        != 1
    ):
        raise UsageError(
            "what E means must be said once: --syringe NAME (the plunger's travel), "
            "--filament-mm D (PrusaSlicer and others, often 1.75), or --line-um W"
        )
    if options.line_um is not None:
        return None
    bores = [options.filament_mm or 0.0] * printer.head_count
    if options.syringe is not None:
        bores = [load(Syringe, n).inner_mm for n in of_each(printer, options.syringe, "--syringe")]
    factors = [1.0] * len(bores) if inks is None else [ink.flow_factor for ink in inks]
    return [np.pi / 4 * d**2 * factor for d, factor in zip(bores, factors, strict=True)]


def is_embedded(file: Path, gcode: bytes, writing: Writing, say: Say) -> bool:
    """Whether the map beside the file counts vessels; without one guess by whether all is level."""
    lines = gcode.count(b"\n") + (not gcode.endswith(b"\n"))
    line_map, _ = read_line_map(file, lines)
    if line_map is not None:
        return line_map.of_vessels
    begin, end = writes_at(gcode, writing)
    embedded = len(begin) > 0 and not is_flat(begin, end)
    say(
        f"note: no line map ({file.stem}.map.npz) says how {file.name} is written; "
        + (
            "it isn't level, so it is read as filaments (--layered reads layers)"
            if embedded
            else "it is level, so it is read as layers (--embedded reads filaments)"
        )
    )
    return embedded


def read_designed(path: Path, unit: LengthUnit | None, say: Say) -> VesselNetwork:
    """The network; in a run folder all files are in mm. ``say`` gets what should be known."""
    if path.is_dir():
        path = path / NETWORK
    if unit is None and (path.parent / MANIFEST).is_file() and path.name == NETWORK:
        unit = "mm"
    network, notes = read_noted(path, unit)
    for note in notes:
        say(f"note: {note}")
    return network


def read_part(
    model: Path | None, network: Path | None, unit: LengthUnit | None, say: Say
) -> Solid | None:
    """The model; of a network in a run folder, the tissue."""
    if model is not None:
        solid = read_model(model, unit)
        for note in solid.notes:
            say(note)
        return solid
    folder = network if network is None or network.is_dir() else network.parent
    if folder is not None and (folder / MANIFEST).is_file() and (folder / SURFACE).is_file():
        return read_solid(folder / SURFACE, "mm")
    return None


def _place_of_layers(place: Place | None, lines: WrittenLines, part: Solid | None) -> np.ndarray:
    """The part's origin: as said, or where the ink lies over the part's sections."""
    if place is not None:
        return np.array(place)
    if part is None:
        raise UsageError(
            "where the part stands isn't known: a network alone has no outside to compare with "
            "the ink; give --place X,Y,Z (the part's origin in the printer's frame) or --model"
        )
    return find_place(lines, part)


def place_of_filaments(place: Place | None, strands: Strands, network: VesselNetwork) -> np.ndarray:
    """The part's origin: as said, or where the filaments lie over the network's axes."""
    if place is not None:
        return np.array(place)
    return find_filament_place(strands, network)
