"""Write a network or G-code file as an HTML page or a picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, Literal, TypeVar

import numpy as np

from design.files import write_bytes
from design.geometry.surface import Surface
from design.network import VesselNetwork
from design.units import LengthUnit
from firmware_profiles import Printer, Syringe, load
from printctl.analysis.meshes import read_model
from printctl.analysis.networks import Drive, Source, load_source
from printctl.checks.gcode_view import Pushing, read_job, read_line_map
from printctl.checks.gcode_view.outline import PartOutlines
from printctl.errors import UsageError
from printctl.pipeline.job.lumens_in_gcode import read_part
from printctl.run_folder.artefacts import SURFACE
from printctl.settings import of, opt, settings, three_numbers
from report import NetworkPage, ReportSurface, write_network_html
from report.gcode import GcodeJob, GcodePage, draw_layer, write_gcode_html
from report.gcode.colouring import PLAIN, Colouring, colourings
from report.pages.network_view import MAX_PIECES
from report.picture import PictureOptions, Quantity, View, draw_picture, quantities

Say = Callable[[str], None]
Shown = Literal[
    "radius", "flow", "pressure", "shear", "order", "tree", "deviation",
    "width", "kind", "speed", "height", "vessel",
]  # fmt: skip
"""`report.picture.Colour` for networks, `report.gcode.GcodeColour` for
G-code; the order is the vessels' in the one, that of writing in the other."""
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


@settings
class ViewOptions:
    """How a network or G-code is shown."""

    colour: Shown | None = opt(
        "What is coloured by at first: radius to deviation a network (kind where it has several, "
        "else radius), width to vessel and order G-code (width; height z of a job in passes).",
        None,
        "--colour",
        "--color",
    )
    seen_from: View = opt("Where the picture is seen from.", "oblique", "--from")
    width: int = opt("Of --png.", 1600, min=300, max=6000)
    palette: bool = opt("Keep --png to 256 colours: a third of the size.", False)
    unit: LengthUnit | None = opt(
        "Of the file, where it doesn't say (.csv, .vtp, .stl, .swc, .txt)."
    )


@settings
class NetworkView:
    """What a network alone takes."""

    tissue: Path | None = opt("A closed mesh, or a run folder; a run has its own.")
    tissue_unit: LengthUnit | None = opt("Of the tissue's mesh.")
    inlet_flow_ml_min: float | None = of(Drive, "inlet_flow_ml_min")
    viscosity_mpa_s: float | None = of(Drive, "viscosity_mpa_s")
    most_pieces: int = opt("Beyond it the page leaves out the thinnest.", MAX_PIECES, min=1)


@settings
class GcodeView:
    """What G-code alone takes; None is left to the file or to a default."""

    layer: int | None = opt(
        "G-code: layer or pass shown first, or drawn, counted from 1; the middle.", min=1
    )
    printer: str | None = opt(
        "G-code: whose head writes, by profile (a valve's file needs it); generic_marlin."
    )
    syringe: str | None = opt("G-code: profile whose bore makes E a volume; hamilton_1ml.")
    filament_mm: float | None = opt(
        "G-code: diameter that E is counted in, instead of a syringe's; as the file says.",
        min=0.01,
        max=100,
    )
    flow_ul_s: float | None = opt(
        "G-code: of a pneumatic head; as the profile measured it.", min=1e-9
    )
    layer_um: float | None = opt(
        "G-code: height of the lines; as the file says, or the spacing of its levels.",
        min=1,
        max=5000,
    )
    model: Path | None = opt(
        "G-code: the part's mesh; its outline is drawn in each layer, coloured by how far ink "
        "lies beyond it."
    )
    place: str | None = opt(
        "G-code: the --model's origin in the printer's frame, mm; found from what is written.",
        metavar="X,Y,Z",
    )


def is_gcode(source: Path) -> bool:
    """Whether a file's name says that it is G-code."""
    return source.suffix.lower() in SUFFIXES and not source.is_dir()


def view_gcode(
    source: Path,
    data: bytes,
    page: Path | None,
    png: Path | None,
    look: ViewOptions,
    settings: GcodeView,
    say: Say,
) -> tuple[dict[str, Path], tuple[str, ...]]:
    """Write the page and the picture of a G-code file that are asked for.

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
    _check_model(look, settings, png)
    job = _read(source, data, settings, say)
    outlines = _outlines(job, settings, look.unit, say)
    there = colourings(job)
    colouring = _chosen(there, look.colour or there[0].key, source)
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
        write_bytes(png, draw_layer(job, layer, colouring, look.width, look.palette, outline))
        written["picture"] = png
    if page is not None:
        first = PLAIN if outlines is not None and look.colour is None else colouring
        write_gcode_html(page, job, GcodePage(first.key, layer), outlines)
        written["page"] = page
    return written, job.notes


def _check_model(look: ViewOptions, settings: GcodeView, png: Path | None) -> None:
    if settings.model is None and look.unit is not None:
        raise UsageError(f"--unit {look.unit}: it is for a network, or of the --model; drop it")
    if settings.model is None and settings.place is not None:
        raise UsageError(f"--place {settings.place}: it is of the --model; give one, or drop it")
    if settings.model is not None and look.colour is not None and png is not None:
        raise UsageError("--colour and --model both colour the picture; give one")


def _outlines(
    job: GcodeJob, settings: GcodeView, unit: LengthUnit | None, say: Say
) -> PartOutlines | None:
    part = read_part(settings.model, None, unit, say)
    if part is None:
        return None
    if job.layers.passes:
        raise UsageError(f"--model {settings.model}: {job.name} isn't written in layers")
    place = None if settings.place is None else np.array(three_numbers(settings.place, "--place"))
    return PartOutlines(job, part, place)


def _read(source: Path, data: bytes, settings: GcodeView, say: Say) -> GcodeJob:
    pushing = _pushing(settings)
    if not data.strip():
        raise UsageError(f"{source} is empty; give a G-code file with moves")
    say(f"reading {source.name} ...")
    line_map, notes = read_line_map(source, data.count(b"\n") + (not data.endswith(b"\n")))
    for note in notes:
        say(note)
    return read_job(data, source.name, pushing, line_map)


def _pushing(settings: GcodeView) -> Pushing:
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


def _layer(job: GcodeJob, requested: int | None, source: Path) -> int:
    """Layer from 0: the middle one of layers, the last of passes, unless the user says."""
    count = len(job.layers)
    if requested is None:
        return count - 1 if job.layers.passes else (count - 1) // 2
    if requested > count:
        noun = "passes" if job.layers.passes else "layers"
        raise UsageError(f"--layer {requested}: {source} has {count} {noun}")
    return requested - 1


_Shown = TypeVar("_Shown", Colouring, Quantity)


def _chosen(known: Sequence[_Shown], colour: str, source: Path) -> _Shown:
    """The colouring that the user named."""
    for one in known:
        if one.key == colour:
            return one
    there = ", ".join(one.key for one in known)
    why = f" ({_NEEDS[colour]})" if colour in _NEEDS else ""
    raise UsageError(f"--colour {colour}: nothing is known of it in {source}{why}; known: {there}")


def view_network(
    source: Path,
    page: Path | None,
    png: Path | None,
    look: ViewOptions,
    settings: NetworkView,
    say: Say,
) -> tuple[dict[str, Path], tuple[str, ...]]:
    """Write the page and the picture of a network that are asked for.

    Returned and raised as by `view_gcode`.
    """
    drive = Drive(settings.inlet_flow_ml_min, settings.viscosity_mpa_s)
    loaded = load_source(source, look.unit, drive)
    surface = _tissue(settings, loaded, say)
    known = quantities(loaded.network, loaded.known)
    chosen = _chosen(known, look.colour or _telling(loaded.network), source)
    written: dict[str, Path] = {}
    if png is not None:
        say("drawing ...")
        options = PictureOptions(look.seen_from, look.width, look.palette)
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


def _tissue(settings: NetworkView, loaded: Source, say: Say) -> Surface | None:
    path, unit = settings.tissue, settings.tissue_unit
    if path is None:
        return loaded.surface
    if path.is_dir():
        path, unit = path / SURFACE, "mm"
    if not path.is_file():
        raise UsageError(f"--tissue {path} isn't there; give a mesh or a run folder")
    solid = read_model(path, unit, option="--tissue-unit")
    for note in solid.notes:
        say(note)
    return solid


def _shown(surface: Surface | None) -> list[ReportSurface]:
    return [ReportSurface("Tissue", surface)] if surface else []
