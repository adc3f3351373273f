"""`printctl view FILE.gcode`: write its layers as an HTML page, or one layer as a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from design.files import write_bytes
from design.units import LengthUnit
from firmware_profiles import Printer, Syringe, load
from printctl.checks.gcode_view import Pushing, read_job, read_line_map
from printctl.checks.gcode_view.outline import PartOutlines
from printctl.cli.lumens_read import read_part
from printctl.cli.options import messages, read_gcode_file, three_numbers
from printctl.errors import UsageError
from registration.report.gcode import (
    GcodeJob,
    GcodePage,
    draw_layer,
    write_gcode_html,
)
from registration.report.gcode.colouring import PLAIN, Colouring, colourings

SUFFIXES: Final = (".gcode", ".gco", ".g", ".nc", ".ngc", ".gc")
_SYRINGE: Final = "hamilton_1ml"
_PRINTER: Final = "generic_marlin"
_NEEDS: Final = {
    "kind": "the file has no comments like ;TYPE:",
    "width": "the flow isn't known; say --flow-ul-s",
    "height": "only a job in passes is coloured by it",
    "vessel": "it takes the FILE.map.npz of a job that writes vessel by vessel",
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
    colouring = _chosen(job, settings.colour, source)
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
    part = read_part(settings.model, None, settings.unit)
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


def _chosen(job: GcodeJob, colour: str | None, source: Path) -> Colouring:
    known = colourings(job)
    if colour is None:
        return known[0]
    for each in known:
        if each.key == colour:
            return each
    there = ", ".join(each.key for each in known)
    why = f" ({_NEEDS[colour]})" if colour in _NEEDS else ""
    raise UsageError(f"--colour {colour}: nothing is known of it in {source}{why}; known: {there}")
