"""Slice meshes for a printer's heads into G-code; map its lines to layers, report figures."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from design.toolpath.fresh import FreshLayers, FreshOptions, FreshReport
from design.toolpath.gcode import (
    GcodeOptions,
    HeadLoad,
    clear_mm,
    joint_mm,
    least_move_mm,
    save_gcode,
    stream_gcode,
)
from firmware_profiles import Dish, Printer, steady_flow
from kernels.arrays import FloatArray
from printctl.checks.set_up import ABOVE_WALL_MM, HeadLoading
from printctl.errors import UsageError
from printctl.pipeline.slicing.parts import Assembly
from printctl.pipeline.writer_options import gcode_options

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
    """

    parts: Assembly
    printer: Printer
    loads: tuple[HeadLoading, ...]
    lines_mm: tuple[float, ...]
    options: FreshOptions
    dish: Dish | None = None


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
    if not job.printer.heads:
        return options
    loads = tuple(
        HeadLoad(one.syringe, one.ink.flow_factor, one.ink.retract_ul, one.ink.plunger_ul_s)
        for one in job.loads
    )
    wall = None if job.dish is None else job.printer.z_mm.low + job.dish.wall_mm + ABOVE_WALL_MM
    return replace(options, heads=loads, safe_z_mm=wall)


def _placed(job: SliceJob) -> tuple[FloatArray, tuple[float, float, float]]:
    """Where the part's origin comes to in the printer's frame, and where the tip begins, mm."""
    printer, (low, high) = job.printer, job.parts.bounds
    reach = _reach(printer)
    for axis, mm, (near, far) in zip("xyz", (high - low).tolist(), reach.T.tolist(), strict=True):
        if mm > far - near:
            tips = "what every tip reaches of " if printer.heads else ""
            raise UsageError(
                f"the part is {mm:g} mm long in {axis}, more than the {far - near:g} mm of "
                f"{tips}{printer.name}; check --unit"
            )
    middle = reach.mean(axis=0)
    place = np.round(np.append(middle[:2] - (low + high)[:2] / 2, reach[0, 2] - low[2]), 3)
    top = min(float(high[2] + place[2]) + _ABOVE_MM, printer.z_mm.high)
    x, y = np.round((low + high)[:2] / 2 + place[:2], 3).tolist()
    return place, (x, y, round(top, 3))


def _reach(printer: Printer) -> FloatArray:
    """Lowest and highest place that every tip reaches, (2, 3), mm."""
    spans = (printer.x_mm, printer.y_mm, printer.z_mm)
    area = np.array([[span.low for span in spans], [span.high for span in spans]])
    offsets = np.array([head.offset_mm.mm for head in printer.heads] or [(0.0, 0.0, 0.0)])
    return np.array([area[0] + offsets.max(axis=0), area[1] + offsets.min(axis=0)])
