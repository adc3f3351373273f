"""`printctl view`: a network in its tissue, or G-code, as a page or as a picture."""

from __future__ import annotations

import os
import sys
import webbrowser
from pathlib import Path
from typing import Annotated, Final, Literal

import typer

from design.files import write_bytes
from design.units import LengthUnit
from printctl.cli.gcode_options import (
    FilamentOption,
    FlowOption,
    GcodePrinterOption,
    GcodeSyringeOption,
    LayerHeightOption,
    LayerOption,
)
from printctl.cli.network_options import (
    InletFlowOption,
    TissueOption,
    TissueUnitOption,
    UnitOption,
    ViscosityOption,
)
from printctl.cli.options import JsonFlag, messages, print_json, print_lines
from printctl.cli.view_gcode import SUFFIXES, GcodeWish, is_gcode, view_gcode
from printctl.errors import UsageError
from printctl.networks import Drive, Source, load_source, read_surface
from printctl.pipeline.stages.tissue import SURFACE
from registration.picture import (
    PictureOptions,
    Quantity,
    Surface,
    View,
    draw_picture,
    quantities,
)
from registration.report import NetworkPage, ReportSurface, write_network_html
from registration.report.network_view import MAX_PIECES

_NEEDS = {
    "deviation": "it takes a run folder with a registered scan",
    "order": "vessels with loops have no orders",
}
_NETWORKS: Final = (".csv", ".vtp", ".swc", ".json", ".npz")
_FOR_NETWORKS: Final = (
    "seen_from", "unit", "tissue", "tissue_unit", "inlet_flow_ml_min", "viscosity_mpa_s",
    "most_pieces",
)  # fmt: skip
_FOR_GCODE: Final = ("layer", "printer", "syringe", "filament_mm", "flow_ul_s", "layer_um")

Shown = Literal[
    "radius", "flow", "pressure", "shear", "order", "tree", "deviation",
    "width", "kind", "speed", "height", "vessel",
]  # fmt: skip
"""`registration.picture.Colour` for networks, `registration.report.gcode.GcodeColour` for G-code;
the order is the vessels' in the one, that of writing in the other."""


def view(
    context: typer.Context,
    source: Annotated[
        Path,
        typer.Argument(
            help="A run folder, a network (.csv, .vtp, .swc, .json, .npz), or G-code (.gcode).",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", help="The page; view.html in the run, NAME.view.html beside a file."),
    ] = None,
    png: Annotated[
        Path | None,
        typer.Option("--png", help="Draw a picture for a paper; without --out no page."),
    ] = None,
    colour: Annotated[
        Shown | None,
        typer.Option(
            "--colour",
            "--color",
            help="What is coloured by at first: radius to deviation a network (radius), width to "
            "vessel and order G-code (width; height z of a job in passes).",
        ),
    ] = None,
    seen_from: Annotated[
        View, typer.Option("--from", help="Where the picture is seen from.")
    ] = "oblique",
    width: Annotated[int, typer.Option("--width", min=300, max=6000, help="Of --png.")] = 1600,
    palette: Annotated[
        bool, typer.Option("--palette", help="Keep --png to 256 colours: a third of the size.")
    ] = False,
    open_page: Annotated[
        bool | None,
        typer.Option("--open/--no-open", help="Open the page in the browser; on a desktop, do."),
    ] = None,
    unit: UnitOption = None,
    tissue: TissueOption = None,
    tissue_unit: TissueUnitOption = None,
    inlet_flow_ml_min: InletFlowOption = 0.25,
    viscosity_mpa_s: ViscosityOption = 1.0,
    most_pieces: Annotated[
        int,
        typer.Option("--most-pieces", min=1, help="Beyond it the page leaves out the thinnest."),
    ] = MAX_PIECES,
    layer: LayerOption = None,
    printer: GcodePrinterOption = None,
    syringe: GcodeSyringeOption = None,
    filament_mm: FilamentOption = None,
    flow_ul_s: FlowOption = None,
    layer_um: LayerHeightOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Show a network or G-code: a page that opens offline, or with --png a picture.

    A network turns, is cut away, and is coloured by any quantity; point at a vessel to read its
    numbers. G-code of any slicer goes by layers, lines to scale; point at one to read its text.
    """
    _check_targets(out, png)
    gcode = is_gcode(source)
    _check_suffix(source)
    _check_options(context, source, gcode)
    page = out if out is not None or png is not None else _default_page(source)
    if gcode:
        wish = GcodeWish(
            colour, layer, printer, syringe, filament_mm, flow_ul_s, layer_um, width, palette
        )
        _finish(*view_gcode(source, page, png, wish), open_page, as_json)
        return
    loaded = load_source(source, unit, Drive(inlet_flow_ml_min, viscosity_mpa_s))
    surface = _tissue(tissue, tissue_unit, loaded)
    known = quantities(loaded.network, loaded.known)
    chosen = _chosen(known, colour or "radius", source)
    written: dict[str, Path] = {}
    if png is not None:
        messages().print("drawing ...")
        options = PictureOptions(seen_from, width, palette)
        write_bytes(png, draw_picture(loaded.network, chosen, surface, options))
        written["picture"] = png
    if page is not None:
        content = NetworkPage(loaded.name, chosen.key, loaded.notes, most_pieces)
        write_network_html(page, loaded.network, known, _shown(surface), content)
        written["page"] = page
    _finish(written, loaded.notes, open_page, as_json)


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
    if source.is_file() and source.suffix.lower() not in (*_NETWORKS, *SUFFIXES):
        raise UsageError(
            f"{source} is neither a network ({', '.join(_NETWORKS)}) nor G-code "
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


def _chosen(known: list[Quantity], colour: str, source: Path) -> Quantity:
    """The quantity that the user named."""
    for quantity in known:
        if quantity.key == colour:
            return quantity
    there = ", ".join(quantity.key for quantity in known)
    why = f" ({_NEEDS[colour]})" if colour in _NEEDS else ""
    raise UsageError(f"--colour {colour}: nothing is known of it in {source}{why}; known: {there}")


def _tissue(path: Path | None, unit: LengthUnit | None, loaded: Source) -> Surface | None:
    if path is None:
        return loaded.surface
    if path.is_dir():
        path, unit = path / SURFACE, "mm"
    if not path.is_file():
        raise UsageError(f"--tissue {path} isn't there; give a mesh or a run folder")
    if unit is None:
        raise UsageError(f"--tissue {path} doesn't say its unit; give --tissue-unit")
    return read_surface(path, unit)


def _shown(surface: Surface | None) -> list[ReportSurface]:
    return [ReportSurface("Tissue", surface.vertices, surface.faces)] if surface else []


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
