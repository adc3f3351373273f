"""`printctl view`: write a network or G-code file as HTML page or picture; chooses the viewer."""

from __future__ import annotations

import os
import sys
import webbrowser
from pathlib import Path
from typing import Final

import typer

from design.network_files.by_suffix import READ
from printctl.analysis.networks import Drive
from printctl.cli import view_options as options
from printctl.cli.gcode_options import (
    FilamentOption,
    FlowOption,
    GcodePrinterOption,
    GcodeSyringeOption,
    LayerHeightOption,
    LayerOption,
    ModelOption,
    PlaceOption,
)
from printctl.cli.network_options import (
    InletFlowOption,
    TissueOption,
    TissueUnitOption,
    UnitOption,
    ViscosityOption,
)
from printctl.cli.options import JsonFlag, messages, print_json, print_lines
from printctl.cli.view_gcode import SUFFIXES, GcodeViewOptions, is_gcode, view_gcode
from printctl.cli.view_network import NetworkViewOptions, view_network
from printctl.errors import UsageError
from registration.report.network_view import MAX_PIECES

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


def view(
    context: typer.Context,
    source: options.SourceArg,
    out: options.OutOption = None,
    png: options.PngOption = None,
    colour: options.ColourOption = None,
    seen_from: options.FromOption = "oblique",
    width: options.WidthOption = 1600,
    palette: options.PaletteFlag = False,
    open_page: options.OpenOption = None,
    unit: UnitOption = None,
    tissue: TissueOption = None,
    tissue_unit: TissueUnitOption = None,
    inlet_flow_ml_min: InletFlowOption = None,
    viscosity_mpa_s: ViscosityOption = None,
    most_pieces: options.MostPiecesOption = MAX_PIECES,
    layer: LayerOption = None,
    printer: GcodePrinterOption = None,
    syringe: GcodeSyringeOption = None,
    filament_mm: FilamentOption = None,
    flow_ul_s: FlowOption = None,
    layer_um: LayerHeightOption = None,
    model: ModelOption = None,
    place: PlaceOption = None,
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
