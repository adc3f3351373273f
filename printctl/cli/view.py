"""`printctl view`: write a network or G-code file as HTML page or picture; chooses the viewer."""

from __future__ import annotations

import os
import sys
import webbrowser
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal, TypeVar

import numpy as np
import typer

from design.files import write_bytes
from design.geometry.surface import Surface
from design.network import VesselNetwork
from design.network_files.by_suffix import READ
from design.solids import read_solid
from design.units import LengthUnit
from firmware_profiles import Printer, Syringe, load
from printctl.analysis.networks import Drive, Source, load_source
from printctl.checks.gcode_view import Pushing, read_job, read_line_map
from printctl.checks.gcode_view.outline import PartOutlines
from printctl.checks.lumens_in_gcode import read_part
from printctl.cli.declare import command
from printctl.cli.options import (
    InletFlowOption,
    JsonFlag,
    TissueOption,
    TissueUnitOption,
    UnitOption,
    ViscosityOption,
    messages,
    print_json,
    print_lines,
    print_note,
    read_gcode_file,
    three_numbers,
)
from printctl.errors import UsageError
from printctl.run_folder.artefacts import SURFACE
from printctl.settings import arg, opt
from registration.report import NetworkPage, ReportSurface, write_network_html
from registration.report.gcode import GcodeJob, GcodePage, draw_layer, write_gcode_html
from registration.report.gcode.colouring import PLAIN, Colouring, colourings
from registration.report.network_view import MAX_PIECES
from registration.report.picture import PictureOptions, Quantity, View, draw_picture, quantities

# Typer options of `printctl view` for networks and all files: page, picture, colour, view.

Shown = Literal[
    "radius", "flow", "pressure", "shear", "order", "tree", "deviation",
    "width", "kind", "speed", "height", "vessel",
]  # fmt: skip
"""`registration.report.picture.Colour` for networks, `registration.report.gcode.GcodeColour` for
G-code; the order is the vessels' in the one, that of writing in the other."""
FromOption = Annotated[View, opt("Where the picture is seen from.", ..., "--from")]


# Typer options of `printctl view FILE.gcode`: layer, syringe, filament, flow, designed part.


# `printctl view FILE.gcode`: write its layers as an HTML page, or one layer as a picture.

SUFFIXES: Final = (".gcode", ".gco", ".g", ".nc", ".ngc", ".gc")
_SYRINGE: Final = "hamilton_1ml"
_PRINTER: Final = "generic_marlin"
_NEEDS: Final = {
    "kind": "the file has no comments like ;TYPE:",
    "width": "the flow isn't known; say --flow-ul-s",
    "height": "only a job in passes is coloured by it",
    "vessel": "it takes the FILE.map.npz of a job that writes vessel by vessel",
    "deviation": "it takes a run folder with a registered scan",
    "order": "vessels with loops have no orders",
}


@dataclass(frozen=True)
class GcodeViewOptions:
    """What the user asks of a G-code file; None is left to the file or to a default."""

    colour: str | None = None
    layer: int | None = None
    printer: str | None = None
    syringe: str | None = None
    filament_mm: float | None = None
    flow_ul_s: float | None = None
    layer_um: float | None = None
    width: int = 1600
    palette: bool = False
    model: Path | None = None
    unit: LengthUnit | None = None
    place: str | None = None


def is_gcode(source: Path) -> bool:
    """Whether a file's name says that it is G-code."""
    return source.suffix.lower() in SUFFIXES and not source.is_dir()


def view_gcode(
    source: Path, page: Path | None, png: Path | None, settings: GcodeViewOptions
) -> tuple[dict[str, Path], tuple[str, ...]]:
    """Write the page and the picture that are asked for.

    Returns
    -------
    written : dict of kind to Path
    notes : tuple of str
        For the user.

    Raises
    ------
    UsageError
        When the file can't be shown, or not as asked.
    """
    _check_model(settings, png)
    job = _read(source, settings)
    outlines = _outlines(job, settings)
    there = colourings(job)
    colouring = _chosen(there, settings.colour or there[0].key, source)
    layer = _layer(job, settings.layer, source)
    written: dict[str, Path] = {}
    if png is not None:
        outline = None if outlines is None else outlines.at(layer)
        if outline is not None and not outline.rings:
            raise UsageError(
                f"layer {layer + 1}, {job.layers.z_mm[layer]:g} mm high, lies above or below "
                f"{settings.model}; check --place {settings.place} (its Z: the part's origin in "
                "the printer's frame), or take another --layer"
            )
        write_bytes(
            png, draw_layer(job, layer, colouring, settings.width, settings.palette, outline)
        )
        written["picture"] = png
    if page is not None:
        first = PLAIN if outlines is not None and settings.colour is None else colouring
        write_gcode_html(page, job, GcodePage(first.key, layer), outlines)
        written["page"] = page
    return written, job.notes


def _check_model(settings: GcodeViewOptions, png: Path | None) -> None:
    if settings.model is None and settings.unit is not None:
        raise UsageError(f"--unit {settings.unit}: it is for a network, or of the --model; drop it")
    if settings.model is None and settings.place is not None:
        raise UsageError(f"--place {settings.place}: it is of the --model; give one, or drop it")
    if settings.model is not None and settings.colour is not None and png is not None:
        raise UsageError("--colour and --model both colour the picture; give one")


def _outlines(job: GcodeJob, settings: GcodeViewOptions) -> PartOutlines | None:
    part = read_part(settings.model, None, settings.unit, print_note)
    if part is None:
        return None
    if job.layers.passes:
        raise UsageError(f"--model {settings.model}: {job.name} isn't written in layers")
    place = None if settings.place is None else np.array(three_numbers(settings.place, "--place"))
    return PartOutlines(job, part, place)


def _read(source: Path, settings: GcodeViewOptions) -> GcodeJob:
    pushing = _pushing(settings)
    data = read_gcode_file(source)
    if not data.strip():
        raise UsageError(f"{source} is empty; give a G-code file with moves")
    messages().print(f"reading {source.name} ...", markup=False)
    line_map, notes = read_line_map(source, data.count(b"\n") + (not data.endswith(b"\n")))
    for note in notes:
        messages().print(note, style="dim", markup=False)
    return read_job(data, source.name, pushing, line_map)


def _pushing(settings: GcodeViewOptions) -> Pushing:
    printer = load(Printer, settings.printer or _PRINTER)
    if settings.filament_mm is not None and settings.syringe is not None:
        raise UsageError("--filament-mm and --syringe both say what E is counted in; give one")
    if printer.pneumatic is not None:
        for option, value in (
            ("--filament-mm", settings.filament_mm),
            ("--syringe", settings.syringe),
        ):
            if value is not None:
                raise UsageError(f"{option}: {printer.name} has no plunger; give --flow-ul-s")
    elif settings.flow_ul_s is not None:
        raise UsageError(
            f"--flow-ul-s: {printer.name} has a plunger, whose E says what flows; name a printer "
            "with a pneumatic head (--printer)"
        )
    syringe = load(Syringe, settings.syringe or _SYRINGE)
    bore, source = settings.filament_mm, "--filament-mm"
    if settings.syringe is not None:
        bore, source = syringe.inner_mm, syringe.name
    return Pushing(
        printer=printer,
        bore_mm=bore,
        bore_said=source,
        syringe_mm=syringe.inner_mm,
        syringe_said=f"{syringe.name}, as neither the file nor --syringe says another",
        flow_ul_s=settings.flow_ul_s,
        layer_mm=None if settings.layer_um is None else settings.layer_um * 1e-3,
    )


def _layer(job: GcodeJob, asked: int | None, source: Path) -> int:
    """Layer from 0: the middle one of layers, the last of passes, unless the user says."""
    count = len(job.layers)
    if asked is None:
        return count - 1 if job.layers.passes else (count - 1) // 2
    if asked > count:
        noun = "passes" if job.layers.passes else "layers"
        raise UsageError(f"--layer {asked}: {source} has {count} {noun}")
    return asked - 1


_Shown = TypeVar("_Shown", Colouring, Quantity)


def _chosen(known: Sequence[_Shown], colour: str, source: Path) -> _Shown:
    """The colouring that the user named."""
    for one in known:
        if one.key == colour:
            return one
    there = ", ".join(one.key for one in known)
    why = f" ({_NEEDS[colour]})" if colour in _NEEDS else ""
    raise UsageError(f"--colour {colour}: nothing is known of it in {source}{why}; known: {there}")


# `printctl view NETWORK`: write a network in its tissue as an HTML page or a PNG picture.


@dataclass(frozen=True)
class NetworkViewOptions:
    """What the user asks of a network."""

    colour: str | None
    seen_from: View
    width: int
    palette: bool
    unit: LengthUnit | None
    tissue: Path | None
    tissue_unit: LengthUnit | None
    drive: Drive
    most_pieces: int


def view_network(
    source: Path, page: Path | None, png: Path | None, settings: NetworkViewOptions
) -> tuple[dict[str, Path], tuple[str, ...]]:
    """Write the page and the picture that are asked for.

    Returns
    -------
    written : dict of kind to Path
    notes : tuple of str
        For the user.

    Raises
    ------
    UsageError
        When the network can't be shown, or not as asked.
    """
    loaded = load_source(source, settings.unit, settings.drive)
    surface = _tissue(settings.tissue, settings.tissue_unit, loaded)
    known = quantities(loaded.network, loaded.known)
    chosen = _chosen(known, settings.colour or _telling(loaded.network), source)
    written: dict[str, Path] = {}
    if png is not None:
        messages().print("drawing ...")
        options = PictureOptions(settings.seen_from, settings.width, settings.palette)
        flow = loaded.known.flow.get("flow_ml_min")
        write_bytes(png, draw_picture(loaded.network, chosen, surface, options, flow))
        written["picture"] = png
    if page is not None:
        content = NetworkPage(loaded.name, chosen.key, loaded.notes, settings.most_pieces)
        write_network_html(page, loaded.network, known, _shown(surface), content)
        written["page"] = page
    return written, loaded.notes


def _telling(network: VesselNetwork) -> str:
    """What a network is coloured by unless the user says: its kinds, where it has several."""
    return "kind" if len(np.unique(network.kind)) > 1 else "radius"


def _tissue(path: Path | None, unit: LengthUnit | None, loaded: Source) -> Surface | None:
    if path is None:
        return loaded.surface
    if path.is_dir():
        path, unit = path / SURFACE, "mm"
    if not path.is_file():
        raise UsageError(f"--tissue {path} isn't there; give a mesh or a run folder")
    if unit is None:
        raise UsageError(f"--tissue {path} doesn't say its unit; give --tissue-unit")
    solid = read_solid(path, unit=unit)
    for note in solid.notes:
        messages().print(note, style="dim", markup=False)
    return solid


def _shown(surface: Surface | None) -> list[ReportSurface]:
    return [ReportSurface("Tissue", surface)] if surface else []


_FOR_NETWORKS: Final = (
    "seen_from", "tissue", "tissue_unit", "inlet_flow_ml_min", "viscosity_mpa_s",
    "most_pieces",
)  # fmt: skip
_FOR_GCODE: Final = (
    "layer",
    "printer",
    "syringe",
    "filament_mm",
    "flow_ul_s",
    "layer_um",
    "model",
    "place",
)


@command
def view(
    context: typer.Context,
    source: Path = arg(
        "A run folder, a network (.csv, .vtp, .swc, .json, .npz, .txt), or G-code (.gcode)."
    ),
    out: Path | None = opt("The page; view.html in the run, NAME.view.html beside a file."),
    png: Path | None = opt("Draw a picture for a paper; without --out no page."),
    colour: Shown | None = opt(
        "What is coloured by at first: radius to deviation a network (kind where it has several, "
        "else radius), width to vessel and order G-code (width; height z of a job in passes).",
        None,
        "--colour",
        "--color",
    ),
    seen_from: FromOption = "oblique",
    width: int = opt("Of --png.", 1600, min=300, max=6000),
    palette: bool = opt("Keep --png to 256 colours: a third of the size.", False),
    open_page: bool | None = opt(
        "Open the page in the browser; on a desktop, do.", None, "--open/--no-open"
    ),
    unit: UnitOption = None,
    tissue: TissueOption = None,
    tissue_unit: TissueUnitOption = None,
    inlet_flow_ml_min: InletFlowOption = None,
    viscosity_mpa_s: ViscosityOption = None,
    most_pieces: int = opt("Beyond it the page leaves out the thinnest.", MAX_PIECES, min=1),
    layer: int | None = opt(
        "G-code: layer or pass shown first, or drawn, counted from 1; the middle.", min=1
    ),
    printer: str | None = opt(
        "G-code: whose head writes, by profile (a valve's file needs it); generic_marlin."
    ),
    syringe: str | None = opt("G-code: profile whose bore makes E a volume; hamilton_1ml."),
    filament_mm: float | None = opt(
        "G-code: diameter that E is counted in, instead of a syringe's; as the file says.",
        min=0.01,
        max=100,
    ),
    flow_ul_s: float | None = opt(
        "G-code: of a pneumatic head; as the profile measured it.", min=1e-9
    ),
    layer_um: float | None = opt(
        "G-code: height of the lines; as the file says, or the spacing of its levels.",
        min=1,
        max=5000,
    ),
    model: Path | None = opt(
        "G-code: the part's mesh; its outline is drawn in each layer, coloured by how far ink "
        "lies beyond it."
    ),
    place: str | None = opt(
        "G-code: the --model's origin in the printer's frame, mm; found from what is written.",
        metavar="X,Y,Z",
    ),
    as_json: JsonFlag = False,
) -> None:
    """Show a network or G-code: a page that opens offline, or with --png a picture.

    A network turns, is cut away, and is coloured by any quantity; point at a vessel to read its
    numbers. G-code of any slicer goes by layers, lines to scale; point at one to read its text.
    """
    gcode = is_gcode(source)
    _check(context, source, out, png, gcode)
    page = out if out is not None or png is not None else _default_page(source)
    if gcode:
        asked = GcodeViewOptions(
            colour, layer, printer, syringe, filament_mm, flow_ul_s, layer_um, width, palette,
            model, unit, place,
        )  # fmt: skip
        written = view_gcode(source, page, png, asked)
    else:
        drive = Drive(inlet_flow_ml_min, viscosity_mpa_s)
        settings = NetworkViewOptions(
            colour, seen_from, width, palette, unit, tissue, tissue_unit, drive, most_pieces
        )
        written = view_network(source, page, png, settings)
    _finish(*written, open_page, as_json)


def _check(
    context: typer.Context, source: Path, out: Path | None, png: Path | None, gcode: bool
) -> None:
    """Refuse what can't be asked of this source, before anything is read."""
    _check_targets(out, png)
    _check_suffix(source)
    _check_options(context, source, gcode)


def _finish(
    written: dict[str, Path], notes: tuple[str, ...], open_page: bool | None, as_json: bool
) -> None:
    _tell(written, notes, as_json)
    if "page" in written and (open_page or (open_page is None and not as_json and _on_desktop())):
        webbrowser.open(written["page"].resolve().as_uri())


def _check_targets(out: Path | None, png: Path | None) -> None:
    for option, path, suffixes in (("--out", out, (".html", ".htm")), ("--png", png, (".png",))):
        if path is not None and (path.suffix.lower() not in suffixes or path.is_dir()):
            raise UsageError(f"{option} {path}: give the name of a {suffixes[0]} file")


def _check_suffix(source: Path) -> None:
    if source.is_file() and source.suffix.lower() not in (*READ, *SUFFIXES):
        raise UsageError(
            f"{source} is neither a network ({', '.join(READ)}) nor G-code "
            f"({', '.join(SUFFIXES)}) by its name; give one of these, or a run folder"
        )


def _check_options(context: typer.Context, source: Path, gcode: bool) -> None:
    """Refuse an option that does nothing for this source."""
    for name in _FOR_NETWORKS if gcode else _FOR_GCODE:
        given = context.get_parameter_source(name)
        if given is not None and given.name == "COMMANDLINE":
            (option,) = (p.opts[0] for p in context.command.params if p.name == name)
            kind = "a network; this is G-code" if gcode else f"G-code ({', '.join(SUFFIXES)})"
            raise UsageError(f"{option} with {source}: it is for {kind}; drop it")


def _default_page(source: Path) -> Path:
    return source / "view.html" if source.is_dir() else source.with_suffix(".view.html")


def _on_desktop() -> bool:
    """Whether a window would be seen: never from a script, nor over a plain SSH connection."""
    shown = sys.platform in ("win32", "darwin") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    return shown and sys.stdout.isatty()


def _tell(written: dict[str, Path], notes: tuple[str, ...], as_json: bool) -> None:
    sizes = {kind: path.stat().st_size for kind, path in written.items()}
    if as_json:
        files = {k: {"file": str(p), "bytes": sizes[k]} for k, p in written.items()}
        print_json({**files, "notes": list(notes)})
        return
    for note in notes:
        messages().print(note, style="dim", markup=False)
    print_lines(*(f"{path} ({_size(sizes[kind])})" for kind, path in written.items()))


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{count / 1e3:.0f} kB"
