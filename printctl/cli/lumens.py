"""`printctl lumens`: predict from any slicer's G-code how wide each designed lumen stays open."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

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
from printctl.cli.declare import command
from printctl.cli.options import (
    JsonFlag,
    PrinterOption,
    messages,
    print_json,
    print_lines,
    print_note,
    read_gcode_file,
    three_numbers,
)
from printctl.errors import SafetyError, UsageError
from printctl.failures import error_facts
from printctl.run_folder.artefacts import NETWORK, SURFACE
from printctl.run_folder.manifest import MANIFEST
from printctl.settings import arg, opt
from sim.gcode.deposit.strands import Strands

# Typer options of `printctl lumens`: G-code, network or part, ink, needle, line widths, origin.


# Format the lumen check's result (open diameters, closed layers, leaks) for the terminal.

Numbers = dict[str, Any]
ROWS: Final = 20
"""Lumens that are shown without ``--all``: those that lose most."""


def lumen_lines(numbers: Numbers, every: bool) -> list[str]:
    """`printctl.checks.lumens.LumenCheck.as_dict` for a terminal, worst lumens first."""
    rows = numbers["lumens"] if every else numbers["lumens"][:ROWS]
    left = len(numbers["lumens"]) - len(rows)
    return [
        *_head(numbers),
        "",
        *(_row(row) for row in (None, *rows)),
        *([f"  … and {left} lumens that lose less (--all shows them)"] if left else []),
        *_closed(numbers["lumens"]),
        *_leaks(numbers["leaks"]),
        *_merges(numbers.get("merges", [])),
    ]


def _head(numbers: Numbers) -> Iterator[str]:
    summary = numbers["summary"]
    yield f"{_what(numbers)}; part's origin at {_at(numbers['place_mm'], 3)} mm"
    yield (
        f"median diameter {summary['diameter_error_median_um']:+.1f} µm from the design, "
        f"{summary['stepped_diameter_error_median_um']:+.1f} after motor steps"
    )
    yield (
        f"conductance against the design: median {100 * summary['conductance_median']:.1f} %, "
        f"least {100 * summary['conductance_least']:.1f} %; after motor steps "
        f"{100 * summary['stepped_conductance_median']:.1f} %, "
        f"{100 * summary['stepped_conductance_least']:.1f} %"
    )
    if numbers["method"] == "layers":
        yield f"{summary['closed']} closed, {summary['leaks']} leaking"
    else:
        yield (
            f"{summary['closed']} not written through, {summary['joints_broken']} of "
            f"{summary['joints']} joints broken, {summary['merges']} merging "
            f"({summary['merges_across_trees']} across trees)"
        )
        yield numbers["meaning"]


def _what(numbers: Numbers) -> str:
    """What was read, and how much of it."""
    count = numbers["summary"]["lumens"]
    if numbers["method"] == "layers":
        return (
            f"{count} lumens among lines of {numbers['line_um']:.0f} µm in layers of "
            f"{numbers['layer_um']:.0f} µm{_bead(numbers['bead_uncertainty_um'])}"
        )
    return (
        f"{count} vessels written in {numbers['passes']} passes of filament, median "
        f"{numbers['filament_um']:.0f} µm"
    )


def _bead(um: list[float]) -> str:
    """What isn't known of the lines' cross-section, in words."""
    if um == [0.0, 0.0]:
        return ""
    return f" (bead not measured: all diameters {um[0]:+.0f} to {um[1]:+.0f} µm)"


def _at(place: list[float], decimals: int = 2) -> str:
    return ", ".join(f"{value:.{decimals}f}" for value in place)


def _row(row: Numbers | None) -> str:
    """One lumen's; None for the heading."""
    if row is None:
        return (
            f"  {'lumen':>6}{'designed':>10}{'narrowest':>11}{'stepped':>9}{'median':>9}"
            f"{'conduct.':>10}{'stepped':>9}{'least':>7}{'layer':>7}  narrowest at / mm\n"
            f"  {'':>6}{'mm':>10}{'mm':>11}{'mm':>9}{'µm off':>9}{'%':>10}{'%':>9}{'%':>7}"
        )
    stepped = row["stepped"]
    layer = "–" if row["layer"] is None else str(row["layer"] + 1)
    return (
        f"  {row['lumen']:>6}{row['designed_mm']:>10.3f}{row['narrowest_mm']:>11.3f}"
        f"{stepped['narrowest_mm']:>9.3f}{row['diameter_error_median_um']:>+9.1f}"
        f"{100 * row['conductance']:>10.1f}{100 * stepped['conductance']:>9.1f}"
        f"{100 * stepped['conductance_least']:>7.1f}{layer:>7}  {_at(row['at_mm'])}"
    )


def _closed(rows: list[Numbers]) -> Iterator[str]:
    for row in rows:
        layers = sorted({*row["closed_layers"], *row["stepped"]["closed_layers"]})
        if layers:
            yield f"CLOSED lumen {row['lumen']} in layer {_spans([k + 1 for k in layers])}"
        elif row["closed"] or row["stepped"]["closed"]:
            here = row if row["closed"] else row["stepped"]
            yield f"NOT WRITTEN THROUGH vessel {row['lumen']}, at {_at(here['at_mm'])} mm"


def _spans(numbers: list[int]) -> str:
    """``3, 7 to 12``."""
    spans: list[list[int]] = []
    for number in numbers:
        if spans and spans[-1][1] == number - 1:
            spans[-1][1] = number
        else:
            spans.append([number, number])
    return ", ".join(f"{a}" if a == b else f"{a} to {b}" for a, b in spans)


def _leaks(leaks: list[Numbers]) -> Iterator[str]:
    for leak in leaks:
        into = leak["into"] if leak["into"] == "outside" else f"tree {leak['into']}"
        at = _at(leak["at_mm"])
        yield f"LEAK from tree {leak['tree']} into {into} in layer {leak['layer'] + 1} at {at} mm"


def _merges(merges: list[Numbers]) -> Iterator[str]:
    for merge in merges:
        one, other = merge["vessels"]
        trees = merge["trees"]
        of = f"of tree {trees[0]}" if trees[0] == trees[1] else f"of trees {trees[0]}, {trees[1]}"
        yield (
            f"MERGE of vessels {one} and {other} ({of}), {1e3 * merge['neck_mm']:.0f} µm wide at "
            f"{_at(merge['at_mm'])} mm"
        )


# Read inputs of `printctl lumens`: designed lumens or part, its origin, ink laid per move.


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


Found = tuple[LumenCheck | FilamentCheck, np.ndarray]


@command
def lumens(
    file: Path = arg("The G-code file."),
    network: Path | None = opt("The designed vessels: a network's file or a run folder."),
    model: Path | None = opt(
        "The part as a closed mesh; without a network its holes are the lumens."
    ),
    unit: LengthUnit | None = opt("Of the network's and the model's files, if they don't say."),
    syringe: str | None = opt(
        "E is the plunger's travel in this syringe; of several heads: left,right."
    ),
    ink: str | None = opt(
        "Whose flow factor (out over pushed) the file was made for, and whose bead lines have "
        "(without one: rounded); of a pneumatic head, what flows."
    ),
    needle: str | None = opt("Of a pneumatic head: through which the ink flows."),
    flow_ul_s: float | None = opt("Of a pneumatic head while its valve is open.", min=1e-9),
    filament_mm: float | None = opt("E is the way of such a filament.", min=0.05, max=20),
    line_um: float | None = opt("All lines are so wide, whatever E is.", min=5, max=10_000),
    layer_um: float | None = opt("Of a file with one layer.", min=1, max=5000),
    embedded: bool = opt(
        "Filaments written along the vessels, not layers; found by itself where writing isn't "
        "level, or where FILE.map.npz says so.",
        False,
    ),
    place: str | None = opt("The part's origin in the printer's frame, mm.", metavar="X,Y,Z"),
    printer: PrinterOption = "generic_marlin",
    leak_um: float = opt("Narrower ways are no leaks.", 50.0, min=10, max=2000),
    every: bool = opt("A row for every lumen.", False, "--all"),
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
