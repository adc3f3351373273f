"""Make the commands that travel to a toolpath's first point, and away from its last."""

from __future__ import annotations

import numpy as np

from design.toolpath.gcode.commands import Stops, join_stops, plunger_mm_per_ul
from design.toolpath.gcode.job import GcodeOptions
from firmware_profiles import Printer, Syringe
from kernels.arrays import FloatArray


def begin_of(first: FloatArray, options: GcodeOptions) -> FloatArray:
    """X, Y, Z and plunger before the first command, (4,) mm.

    Made up where nobody knows: any other place than ``first`` (3,) does, it only gives the moves a
    direction.
    """
    return np.append(first - 1.0 if options.start_mm is None else options.start_mm, 0.0)


def approach_commands(
    begin: FloatArray, first: FloatArray, top: float, printer: Printer, options: GcodeOptions
) -> Stops:
    """Straight up or down to ``top``, across, and down to ``first`` (3,): three commands."""
    high = top if options.start_mm is None else max(top, float(begin[2]))
    limits = printer.max_speed_mm_s
    level = min(options.travel_speed_mm_s, limits.x, limits.y)
    rise, to = min(options.travel_speed_mm_s, limits.z), np.append(first, 0.0)
    return join_stops(
        [
            Stops.to(at_height(begin, high), rise, 0),
            Stops.to(at_height(to, high), level, 0),
            Stops.to(to, rise, 0),
        ]
    )


def departure_commands(
    last: FloatArray, top: float, printer: Printer, syringe: Syringe, options: GcodeOptions
) -> Stops:
    """Relieve the plunger at ``last`` (4,) and go straight up to ``top``: two commands."""
    per_ul = plunger_mm_per_ul(printer, syringe)
    relieved = last - [0.0, 0.0, 0.0, options.relieve_ul * per_ul]
    rise = min(options.travel_speed_mm_s, printer.max_speed_mm_s.z)
    return join_stops(
        [
            Stops.to(relieved, options.plunger_ul_s * per_ul, 1),
            Stops.to(at_height(relieved, top), rise, 0),
        ]
    )


def at_height(position: FloatArray, z_mm: float) -> FloatArray:
    """The same place, (4,), at another height."""
    moved = position.copy()
    moved[2] = z_mm
    return moved
