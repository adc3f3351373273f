"""The whole trip of the needle: to the first point, along the toolpath, and away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.toolpath.gcode.air import at_flow
from design.toolpath.gcode.commands import Stops, joined, plunger_mm_per_ul, stops
from design.toolpath.gcode.job import GcodeOptions
from design.toolpath.toolpath import FloatArray, Toolpath
from firmware_profiles import Printer, Syringe


@dataclass(frozen=True)
class Trip:
    """Commands of a job.

    Attributes
    ----------
    begin : (4,) float64, mm
        X, Y, Z and plunger before the first command; made up where `known` is False.
    known : bool
        Whether the job declares its begin to the firmware.
    stops : Stops
        The first three go to the toolpath's begin: up or down, across, down.
    """

    begin: FloatArray
    known: bool
    stops: Stops


def round_trip(
    toolpath: Toolpath,
    printer: Printer,
    syringe: Syringe,
    place_mm: FloatArray,
    options: GcodeOptions,
) -> Trip:
    """Put the way in and the way out around a toolpath's commands."""
    body = stops(toolpath, printer, syringe, place_mm, options.flow_factor)
    first = np.append(toolpath.start[0] + place_mm, 0.0)
    if printer.pneumatic:
        body = at_flow(body, toolpath, printer, first[:3], options)
    path_top = max(float(body.position[:, 2].max()), float(first[2]))
    top = max(min(path_top + options.clearance_mm, printer.z_mm.high), path_top)
    known = options.start_mm is not None
    # Any other place does where the begin isn't known: it only gives the moves a direction.
    begin = np.append(first[:3] - 1.0 if options.start_mm is None else options.start_mm, 0.0)
    high = max(top, float(begin[2])) if known else top
    limits = printer.max_speed_mm_s
    level = min(options.travel_speed_mm_s, limits.x, limits.y)
    rise = min(options.travel_speed_mm_s, limits.z)
    per_ul = plunger_mm_per_ul(printer, syringe)
    relieved = body.position[-1] - [0.0, 0.0, 0.0, options.relieve_ul * per_ul]
    way_in = [
        Stops.to(_at_height(begin, high), rise, 0),
        Stops.to(_at_height(first, high), level, 0),
        Stops.to(first, rise, 0),
    ]
    way_out = [
        Stops.to(relieved, options.plunger_ul_s * per_ul, 1),
        Stops.to(_at_height(relieved, top), rise, 0),
    ]
    return Trip(begin, known, joined([*way_in, body, *way_out]))


def _at_height(position: FloatArray, z_mm: float) -> FloatArray:
    moved = position.copy()
    moved[2] = z_mm
    return moved
