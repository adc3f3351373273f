"""Slice mesh files without a recipe: parts, modifiers, heads, placement.

Goes in: meshes and options. Comes out: G-code.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.solids import Solid
from design.solids.manifolds import solid_manifold
from design.toolpath.fresh import Filling, FreshLayers, FreshOptions, FreshReport, Region
from design.toolpath.gcode import (
    GcodeOptions,
    clear_mm,
    joint_mm,
    least_move_mm,
    save_gcode,
    stream_gcode,
)
from design.units import LengthUnit
from firmware_profiles import Bath, Dish, Printer, steady_flow
from kernels.arrays import FloatArray
from printctl.analysis.meshes import read_model
from printctl.checks.made_for import header_lines, made_for
from printctl.checks.set_up import ABOVE_WALL_MM, HeadLoading
from printctl.errors import UsageError
from printctl.pipeline.job.heads import gcode_options, head_loads, speed_notes
from printctl.pipeline.job.modifiers import Modifier


@dataclass(frozen=True)
class Assembly:
    """Meshes in one frame, and the places among them that are written in another way.

    Attributes
    ----------
    solids : tuple of Solid
    heads : tuple of int
        Which head writes each.
    regions : tuple of Region
        Where two overlap, the last counts: the later mesh, and any modifier.
    """

    solids: tuple[Solid, ...]
    heads: tuple[int, ...]
    regions: tuple[Region, ...]

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of all meshes, (2, 3), mm."""
        corners = np.array([solid.bounds for solid in self.solids])
        return np.array([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])


def assemble(
    models: Sequence[Path],
    heads: Sequence[int],
    modifiers: Sequence[Modifier],
    filling: Filling,
    unit: LengthUnit | None,
) -> Assembly:
    """Read the meshes and modifiers of a part.

    Parameters
    ----------
    models : sequence of Path
        Their coordinates are in one frame, as a CAD program exports the bodies of an assembly.
    heads : sequence of int
        Of each model.
    modifiers : sequence of Modifier
    filling : Filling
        Of all that no modifier is in.
    unit : "um", "mm", "cm", "m" or "in"
        Of all files; None where each says it itself.

    Raises
    ------
    UsageError
        No unit of a file that holds none, or a modifier that lies outside of all models.
    SolidError
        For a mesh that can't be read or isn't closed.
    """
    solids = tuple(read_model(model, unit, for_sections=True) for model in models)
    # With one mesh of head 0 there is nothing to part.
    parted = [] if set(heads) == {0} else zip(solids, heads, strict=True)
    regions = [Region(solid, filling, head) for solid, head in parted]
    bodies = None
    for modifier in modifiers:
        own = read_model(modifier.path, unit)
        bodies = bodies or [
            solid_manifold(*pair) for pair in zip(solids, map(str, models), strict=True)
        ]
        place = solid_manifold(own, str(modifier.path))
        if all((body ^ place).is_empty() for body in bodies):
            raise UsageError(
                f"--modifier {modifier.path} lies outside of the part ({_span(own)}; the part "
                f"{_span(*solids)}), so it would change nothing; export it in the part's frame "
                "and unit"
            )
        regions.append(Region(own, modifier.filling(filling), modifier.head))
    return Assembly(solids, tuple(heads), tuple(regions))


def head_of_each(text: str | None, models: int, printer: Printer) -> list[int]:
    """Head of each mesh: as said (``0,1,1``), else one after the other.

    Raises
    ------
    UsageError
        For another number of heads than of meshes, or a head that the printer hasn't.
    """
    count = printer.head_count
    if text is None:
        if count > 1 and models > count:
            raise UsageError(
                f"{models} meshes for the {count} heads of {printer.name}; say which head writes "
                f"each with --heads, like --heads {','.join(str(k % count) for k in range(models))}"
            )
        return [k if count > 1 else 0 for k in range(models)]
    try:
        heads = [int(word) for word in text.split(",")]
    except ValueError as exc:
        raise UsageError(
            f"--heads {text!r} isn't a list of numbers; write one for each mesh, like 0,1"
        ) from exc
    if len(heads) != models:
        raise UsageError(f"--heads {text!r} names {len(heads)}, for {models} meshes; one for each")
    for head in heads:
        if not 0 <= head < count:
            raise UsageError(
                f"--heads {text!r}: {printer.name} has no head {head}, only 0 to {count - 1}; "
                "name one of them, or choose another --printer"
            )
    return heads


def _span(*solids: Solid) -> str:
    corners = np.array([solid.bounds for solid in solids])
    low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    words = (f"{a} {x:g} to {y:g}" for a, x, y in zip("xyz", low, high, strict=True))
    return f"{', '.join(words)} mm"


#: Height of the tip above the part when the job begins, mm.
_ABOVE_MM: Final = 5.0


@dataclass(frozen=True)
class SliceJob:
    """What is written, by what, and how.

    Attributes
    ----------
    parts : Assembly
    printer : Printer
    loads : tuple of HeadLoading
        What each head holds, its needle too.
    lines_mm : tuple of float, mm
        Width of each head's lines.
    options : FreshOptions
        All that the heads have in common.
    dish : Dish or None
        Above whose wall heads are changed.
    clearance_mm : float, mm
        Of the part's lowest point above the floor.
    place_mm : (x, y, z) or None, mm
        Where the meshes' origin goes, printer's frame; None centres the part.
    bath : Bath or None
        That the job is recorded to be made for; None where any will do.
    """

    parts: Assembly
    printer: Printer
    loads: tuple[HeadLoading, ...]
    lines_mm: tuple[float, ...]
    options: FreshOptions
    dish: Dish | None = None
    clearance_mm: float = 0.0
    place_mm: tuple[float, float, float] | None = None
    bath: Bath | None = None


@dataclass(frozen=True)
class JobFigures:
    """Figures of a written job.

    Attributes
    ----------
    report : FreshReport
    lines : int
        Commands of G-code.
    place_mm : (3,) float64, mm
        Where the part's origin stands in the printer's frame.
    heights_mm : (float, float), mm
        Of the lowest and the highest layer.
    height_mm, part_mm : float, mm
        Of all layers, and of the part: whole layers come as near as they can.
    """

    report: FreshReport
    lines: int
    place_mm: FloatArray
    heights_mm: tuple[float, float]
    height_mm: float
    part_mm: float


def slice_parts(job: SliceJob, out: Path) -> JobFigures:
    """Write a job's G-code to ``out`` and its line map beside it.

    Raises
    ------
    UsageError
        When the part is larger than what every tip reaches.
    ToolpathError
        As `FreshLayers` and `stream_gcode`.
    """
    place, start = _placed(job)
    each = tuple(_options_of(job, number) for number in range(job.printer.head_count))
    layers = FreshLayers(job.parts.solids, each[0], job.parts.regions, each[1:])
    machine = (job.printer, job.loads[0].syringe, place, _writer(job, start))
    parts = stream_gcode(layers, *machine, layers.top_mm)
    lines = save_gcode(out, out.with_suffix(".map.npz"), parts)
    heights = np.diff(layers.levels)
    low, high = job.parts.bounds
    return JobFigures(
        layers.report(),
        lines,
        place,
        (float(heights.min()), float(heights.max())),
        float(np.ptp(layers.levels)),
        float(high[2] - low[2]),
    )


def _options_of(job: SliceJob, number: int) -> FreshOptions:
    """The planner's choices for a head, by its ink, lines and plunger."""
    printer, ink = job.printer.of_head(number), job.loads[number].ink
    return replace(
        job.options,
        line_width_mm=job.lines_mm[number],
        bead=ink.bead_section,
        retract_ul=ink.retract_ul,
        plunger_ul_s=ink.plunger_ul_s,
        least_move_mm=least_move_mm(printer),
        clear_mm=clear_mm(printer),
        joint_mm=joint_mm(printer),
    )


def _writer(job: SliceJob, start: tuple[float, float, float]) -> GcodeOptions:
    """The writer's choices: of one head, or what each of several holds."""
    first, head = job.loads[0], job.printer.pneumatic
    needle = first.needle
    flow = None if head is None or needle is None else steady_flow(head, first.ink, needle).ul_s
    options = gcode_options(first.ink, start, FreshOptions.travel_speed_mm_s, flow)
    header = header_lines(made_for(job.printer, job.loads, job.bath, job.dish))
    options = replace(options, header=header)
    if not job.printer.heads:
        return options
    loads = head_loads(job.printer, job.loads)
    wall = None if job.dish is None else job.printer.z_mm.low + job.dish.wall_mm + ABOVE_WALL_MM
    return replace(options, heads=loads, safe_z_mm=wall)


def _placed(job: SliceJob) -> tuple[FloatArray, tuple[float, float, float]]:
    """Where the part's origin comes to in the printer's frame, and where the tip begins, mm."""
    printer, (low, high) = job.printer, job.parts.bounds
    reach = _reach(printer)
    floor = reach[0, 2] + job.clearance_mm
    tips = "what every tip reaches of " if printer.heads else ""
    room = [*np.diff(reach[:, :2], axis=0)[0].tolist(), float(reach[1, 2] - floor)]
    for axis, mm, most in zip("xyz", (high - low).tolist(), room, strict=True):
        if mm > most:
            above = f", {job.clearance_mm:g} mm above the floor" if axis == "z" else ""
            raise UsageError(
                f"the part is {mm:g} mm long in {axis}, more than the {most:g} mm of "
                f"{tips}{printer.name}{above}; check --unit, or use a larger --printer"
            )
    middle = reach.mean(axis=0)
    place = np.round(np.append(middle[:2] - (low + high)[:2] / 2, floor - low[2]), 3)
    if job.place_mm is not None:
        place = _checked_place(job, reach, place)
    top = min(float(high[2] + place[2]) + _ABOVE_MM, printer.z_mm.high)
    x, y = np.round((low + high)[:2] / 2 + place[:2], 3).tolist()
    return place, (x, y, round(top, 3))


def _checked_place(job: SliceJob, reach: FloatArray, centred: FloatArray) -> FloatArray:
    """Return the place that the user gives; raise `UsageError` where tips don't reach the part."""
    place = np.array(job.place_mm)
    corners = job.parts.bounds + place
    for k, axis in enumerate("xyz"):
        low, high = corners[:, k].tolist()
        if low < reach[0, k] or high > reach[1, k]:
            given, middle = (",".join(f"{mm:g}" for mm in at) for at in (place, centred))
            raise UsageError(
                f"--place {given} puts the part at {axis} {low:g} to {high:g} mm, and "
                f"{job.printer.name} reaches {reach[0, k]:g} to {reach[1, k]:g} mm; "
                f"--place {middle} centres it"
            )
    return place


def _reach(printer: Printer) -> FloatArray:
    """Lowest and highest place that every tip reaches, (2, 3), mm."""
    spans = (printer.x_mm, printer.y_mm, printer.z_mm)
    area = np.array([[span.low for span in spans], [span.high for span in spans]])
    offsets = np.array([head.offset_mm.mm for head in printer.heads] or [(0.0, 0.0, 0.0)])
    return np.array([area[0] + offsets.max(axis=0), area[1] + offsets.min(axis=0)])


HEIGHT_SHARE: Final = 0.01
"""Of the part's height: what layers may be off by before it is told."""


def job_notes(job: SliceJob, written: JobFigures) -> list[str]:
    """Return what a person should know before printing."""
    notes = [note for solid in job.parts.solids for note in solid.notes]
    report = written.report
    notes += [*_height_note(written), *report.overlap_notes, *report.narrow_notes]
    speed = job.options.write_speed_mm_s
    if speed != FreshOptions.write_speed_mm_s:
        notes += speed_notes(job.printer, f"--speed {speed:g}")
    for number, ul in enumerate(written.report.written_ul_of_heads):
        barrel = job.loads[number].syringe
        if ul > barrel.volume_ul:
            notes.append(
                f"{ul:.4g} µL is more than {barrel.name} holds ({barrel.volume_ul:g} µL)"
                f"{f' in head {number}' if job.printer.heads else ''}: it will be changed on the "
                "way (printctl reload)"
            )
    if written.report.changes and job.dish is None:
        notes.append(
            "heads are changed 5 mm above the part, wherever the dish's wall ends; give --dish to "
            "have them changed above it"
        )
    return notes


def _height_note(written: JobFigures) -> list[str]:
    """Say where whole layers make the part more than a hundredth higher or lower."""
    off = written.height_mm - written.part_mm
    if abs(off) <= HEIGHT_SHARE * written.part_mm:
        return []
    return [
        f"the part is {written.part_mm:.4g} mm high and its {written.report.layers} layers "
        f"{written.height_mm:.4g} mm: {abs(off):.2g} mm {'more' if off > 0 else 'less'} than "
        "designed; choose --layer-um so that whole layers fill it"
    ]


def job_facts(
    job: SliceJob, written: JobFigures, models: Sequence[Path], out: Path
) -> dict[str, Any]:
    """Return the figures of a written job as plain values, for JSON."""
    report = written.report
    facts = {
        "gcode": str(out),
        "layers": report.layers,
        "layer_um": [1e3 * height for height in written.heights_mm],
        "lines": written.lines,
        "written_ul": report.written_ul,
        "part_ul": report.part_ul,
        "material_ul": report.material_ul,
        "unfilled_percent": 100 * report.unfilled_fraction,
        **{
            name: None if places is None else asdict(places)
            for name, places in (
                ("thin_walls", report.thin_walls or report.low_walls),
                ("narrow_gaps", report.narrow_gaps or report.low_gaps),
            )
        },
        "travels": report.travels,
        "lifted": report.lifted,
        "place_mm": written.place_mm.tolist(),
    }
    if not job.printer.heads:
        return facts
    facts["meshes"] = [
        {"file": str(model), "head": head}
        for model, head in zip(models, job.parts.heads, strict=True)
    ]
    facts["changes"] = report.changes
    facts["heads"] = [
        {"head": number, "name": one.name, "ink": job.loads[number].ink.name, "written_ul": ul}
        for number, (one, ul) in enumerate(
            zip(job.printer.heads, _of_each_head(job, report.written_ul_of_heads), strict=True)
        )
    ]
    return facts


def _of_each_head(job: SliceJob, written: tuple[float, ...]) -> tuple[float, ...]:
    return written + (0.0,) * (job.printer.head_count - len(written))
