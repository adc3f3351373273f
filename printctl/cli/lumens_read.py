"""Read inputs of `printctl lumens`: designed lumens or part, its origin, ink laid per move."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from design.network import VesselNetwork
from design.solids import Solid, read_solid
from design.units import LengthUnit
from firmware_profiles import Ink, Needle, Printer, Syringe, load, steady_flow
from firmware_profiles.bead import BeadSection
from printctl.analysis.networks import read_noted
from printctl.checks.gcode_view import read_line_map
from printctl.checks.gcode_view.levels import is_flat
from printctl.checks.lumens import (
    Writing,
    WrittenLines,
    find_filament_place,
    find_place,
    writes_at,
)
from printctl.checks.set_up import of_each
from printctl.cli.options import print_note, three_numbers
from printctl.errors import UsageError
from printctl.run_folder.artefacts import NETWORK, SURFACE
from printctl.run_folder.manifest import MANIFEST
from sim.gcode.deposit.strands import Strands


@dataclass(frozen=True)
class InkOptions:
    """What the user says of ink and E; None is left open."""

    printer: str
    syringe: str | None = None
    ink: str | None = None
    needle: str | None = None
    flow_ul_s: float | None = None
    filament_mm: float | None = None
    line_um: float | None = None
    layer_um: float | None = None


def writing_of(options: InkOptions) -> Writing:
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


def _flow(options: InkOptions, printer: Printer) -> float:
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


def _areas(options: InkOptions, printer: Printer, inks: list[Ink] | None) -> list[float] | None:
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


def is_embedded(file: Path, gcode: bytes, writing: Writing) -> bool:
    """Whether the map beside the file counts vessels, or writing isn't level."""
    lines = gcode.count(b"\n") + (not gcode.endswith(b"\n"))
    line_map, _ = read_line_map(file, lines)
    if line_map is not None:
        return line_map.of_vessels
    begin, end = writes_at(gcode, writing)
    return len(begin) > 0 and not is_flat(begin, end)


def read_designed(path: Path, unit: LengthUnit | None) -> VesselNetwork:
    """The network; in a run folder all files are in mm."""
    if path.is_dir():
        path = path / NETWORK
    if unit is None and (path.parent / MANIFEST).is_file() and path.name == NETWORK:
        unit = "mm"
    network, notes = read_noted(path, unit)
    for note in notes:
        print_note(f"note: {note}")
    return network


def read_part(model: Path | None, network: Path | None, unit: LengthUnit | None) -> Solid | None:
    """The model; of a network in a run folder, the tissue."""
    if model is not None:
        solid = read_solid(model, unit)
        for note in solid.notes:
            print_note(note)
        return solid
    folder = network if network is None or network.is_dir() else network.parent
    if folder is not None and (folder / MANIFEST).is_file() and (folder / SURFACE).is_file():
        return read_solid(folder / SURFACE, "mm")
    return None


def place_of_layers(text: str | None, lines: WrittenLines, part: Solid | None) -> np.ndarray:
    """The part's origin: as said, or where the ink lies over the part's sections."""
    if text is not None:
        return np.array(three_numbers(text, "--place"))
    if part is None:
        raise UsageError(
            "where the part stands isn't known: a network alone has no outside to compare with "
            "the ink; give --place X,Y,Z (the part's origin in the printer's frame) or --model"
        )
    return find_place(lines, part)


def place_of_filaments(text: str | None, strands: Strands, network: VesselNetwork) -> np.ndarray:
    """The part's origin: as said, or where the filaments lie over the network's axes."""
    if text is not None:
        return np.array(three_numbers(text, "--place"))
    return find_filament_place(strands, network)
