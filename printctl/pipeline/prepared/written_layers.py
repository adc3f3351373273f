"""Read the written FRESH layers of a run folder, and the design's outlines there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np
from rich.console import Console

from design.solids import Solid, read_solid
from design.toolpath.correction import Corrections, Stretch
from design.toolpath.fresh import Compensation
from kernels.arrays import FloatArray
from printctl.checks.gcode_view import Pushing, read_job, read_line_map
from printctl.checks.gcode_view.outline import Design, PartOutlines
from printctl.corrections.compensation import corrections_of_file, load_compensation
from printctl.errors import UsageError
from printctl.pipeline.context import RunContext, default_place
from printctl.pipeline.prepared.apply_compensation import written_solid
from printctl.progress import StageBars
from printctl.recipe import parse_recipe
from printctl.recipe.sections.toolpath import Fresh
from printctl.run_folder.artefacts import GCODE, LUMEN, PRINTED_WITH, SOLID, SURFACE
from printctl.run_folder.manifest import MANIFEST, Manifest
from registration.overlay import LayerLines, layers_of
from report.gcode import GcodeJob
from report.gcode.outline_pack import beyond_um


@dataclass(frozen=True, eq=False)
class WrittenRun:
    """What a run of FRESH layers wrote, and what it was to become.

    Attributes
    ----------
    name : str
        The recipe's.
    layers : tuple of LayerLines
        The lowest first, part frame.
    line_mm : float, mm
        Width of the recipe's lines.
    solid, lumen : Solid
        The construct and its lumens, part frame.
    thinnest_mm : float, mm
        Diameter of the thinnest lumen.
    corrected : bool
        Whether lumens were written otherwise than they are to become, which is the design.
    notes : tuple of str
        What a reader must know of these lines.
    """

    name: str
    layers: tuple[LayerLines, ...]
    line_mm: float
    solid: Solid
    lumen: Solid
    thinnest_mm: float
    corrected: bool
    notes: tuple[str, ...]


def read_written(
    folder: Path, console: Console, fit: Literal["scaled", "rigid"] = "scaled"
) -> WrittenRun:
    """Read a run folder whose toolpath is done; the print needn't be.

    A scan that a scaled fit brings to the design's size gets lines of that size, too.

    Raises
    ------
    UsageError
        When it is no run folder, has no G-code yet, or was not written in layers.
    """
    context = run_context(folder, console)
    part = context.recipe.toolpath
    if not isinstance(part, Fresh):
        raise UsageError(
            f"--model {folder} is written vessel by vessel ({part.method}) and has no layers to "
            "lay a scan over; `printctl register` measures its vessels"
        )
    gcode = (folder / GCODE).read_bytes()
    line_map, _ = read_line_map(folder / GCODE, gcode.count(b"\n"))
    job = read_job(gcode, GCODE, pushing_of(context), line_map)
    notes = []
    corrections = _corrections(folder, part)
    stretch = corrections.stretch
    if not stretch.is_neutral:
        text = (
            "are drawn in the design's size, which the scaled fit gives the scan"
            if fit == "scaled"
            else "are drawn as written, over a part that may have shrunk since"
        )
        notes.append(f"The G-code isn't of the design's size (compensation): lines {text}.")
    corrected = fit == "scaled" and corrections.changes_lumens
    if corrected:
        notes.append(
            "Lumens were written otherwise than designed (compensation), so that they come out as "
            "designed: gel is held against the design's, and lines count outside of them only."
        )
    if context.printer.heads:
        notes.append("Line widths are those of the first head's syringe.")
    return WrittenRun(
        name=context.recipe.name,
        layers=layers_of(job, _place(context), stretch if fit == "scaled" else None),
        line_mm=part.line_um * 1e-3,
        solid=context.solid,
        lumen=context.lumen,
        thinnest_mm=2 * float(context.network.radius.min()),
        corrected=corrected,
        notes=tuple(notes),
    )


def _corrections(folder: Path, part: Fresh) -> Corrections:
    """Designed to written: by a compensation's file, or by the recipe's own numbers."""
    if part.compensation is not None:
        return corrections_of_file(load_compensation(folder / PRINTED_WITH))
    x, y, z = (1 / (1 - share / 100) for share in part.compensate.shrink_percent)
    return Corrections(Stretch((x, y, z)), radial_mm=part.compensate.radial_um * 1e-3)


def run_context(folder: Path, console: Console) -> RunContext:
    """The run as its manifest remembers it, with all that its layers are held against."""
    if not folder.is_dir():
        raise UsageError(f"--model {folder} isn't a folder; give a run folder of `printctl run`")
    if "recipe" not in Manifest.load(folder).facts:
        raise UsageError(
            f"--model {folder} has no {MANIFEST} of a run; give a folder of `printctl run` or "
            "`printctl toolpath`"
        )
    for name in (GCODE, LUMEN, SOLID, SURFACE):
        if not (folder / name).is_file():
            raise UsageError(
                f"--model {folder} has no {name}; run its recipe first (`printctl toolpath`)"
            )
    return remembered(folder, console)


def remembered(folder: Path, console: Console) -> RunContext:
    """The run as its manifest remembers it, whatever of it is there.

    Raises
    ------
    RecipeError
        When the manifest has no recipe of a run.
    """
    manifest = Manifest.load(folder)
    recipe = parse_recipe(manifest.facts.get("recipe", {}), str(folder / MANIFEST))
    return RunContext(recipe, folder, folder, manifest, StageBars(console))


def pushing_of(context: RunContext) -> Pushing:
    """How E becomes a volume: what comes out, not what is pushed; the bore that would give it."""
    part, syringe, factor = context.recipe.toolpath, context.syringe, context.ink.flow_factor**0.5
    return Pushing(
        printer=context.printer,
        bore_mm=None if context.printer.pneumatic else syringe.inner_mm * factor,
        bore_said=syringe.name,
        syringe_mm=syringe.inner_mm,
        syringe_said=syringe.name,
        flow_ul_s=context.flow_ul_s,
        layer_mm=part.even_layer_mm if isinstance(part, Fresh) else None,
        bead=context.ink.bead_section,
    )


def _place(context: RunContext) -> FloatArray:
    """Where the part stands in the printer's frame, from the surface that the run kept."""
    if context.recipe.printer.place_mm is not None:
        return np.array(context.recipe.printer.place_mm)
    low, high = read_solid(context.folder / SURFACE, unit="mm").bounds
    return default_place(low, high, context.printer, context.bath)


_FAR_UM: Final = 150.0


def outlined_design(context: RunContext) -> Design | None:
    """The part as it is to be written and its place; None where nothing is written in layers."""
    part = context.recipe.toolpath
    if not isinstance(part, Fresh):
        return None
    larger = Compensation(part.compensate.shrink_percent)
    return larger.enlarged(written_solid(context)), context.place_mm


def run_outlines(run: Path, job: GcodeJob) -> PartOutlines | None:
    """Outlines of a run folder's layers.

    None where the run has no layers or not all its files, or where its lines don't lie in its part
    (a well of a plate, which stands elsewhere in the plate's job).
    """
    try:
        design = outlined_design(run_context(run, Console(quiet=True)))
    except UsageError:
        return None
    if design is None or job.layers.passes:
        return None
    outlines = PartOutlines(job, *design)
    beyond = beyond_um(outlines.at((len(job.layers) - 1) // 2))
    return outlines if beyond and abs(beyond[1]) < _FAR_UM else None
