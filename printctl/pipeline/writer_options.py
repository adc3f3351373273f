"""G-code writer options from an ink profile: relief, plunger rate, flow factor, writing speeds."""

from __future__ import annotations

from design.toolpath.gcode import GcodeOptions
from firmware_profiles import Ink


def gcode_options(
    ink: Ink,
    start_mm: tuple[float, float, float],
    travel_speed_mm_s: float,
    flow_ul_s: float | None,
) -> GcodeOptions:
    """The writer's choices for an ink; ``flow_ul_s`` is a pneumatic head's, else None."""
    span = ink.write_speed_mm_s
    return GcodeOptions(
        start_mm=start_mm,
        travel_speed_mm_s=travel_speed_mm_s,
        relieve_ul=ink.retract_ul,
        plunger_ul_s=ink.plunger_ul_s,
        flow_factor=ink.flow_factor,
        flow_ul_s=flow_ul_s,
        ink_speed_mm_s=None if span is None else (span.low, span.high),
    )
