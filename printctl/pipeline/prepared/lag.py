"""Compensate a recipe's toolpath for the ink's measured pressure lag, and size the relief."""

from __future__ import annotations

from typing import Final

from design.toolpath import Toolpath
from design.toolpath.added_moves import compensate_lag
from gcode.bead.flow import nozzle_of
from printctl.checks.bead import lag_of
from printctl.errors import UsageError
from printctl.pipeline.context import RunContext
from printctl.pipeline.job.heads import Filled

OF_SPEED: Final = 0.5
"""Of the plunger's fastest, at which pressure is built and taken back."""


def ahead_of_lag(context: RunContext, toolpath: Toolpath) -> Toolpath:
    """The path with `design.toolpath.added_moves`'s compensation.

    Raises
    ------
    UsageError
        Where the lag isn't known, the firmware compensates too, or the head isn't one plunger.
    """
    printer, load = context.printer, context.loads[0]
    if printer.pneumatic or printer.heads:
        raise UsageError(
            f"toolpath.compensate_lag: {printer.name} has "
            f"{'several heads' if printer.heads else 'a pneumatic head'}, and only a single "
            "plunger is driven ahead of a lag; leave it out"
        )
    if printer.advance_s > 0:
        raise UsageError(
            f"toolpath.compensate_lag: the firmware of {printer.name} holds an advance of "
            f"{printer.advance_s:g} s (advance_s), and both would compensate; leave one out"
        )
    area = load.syringe.area_mm2 * load.ink.flow_factor
    rate = OF_SPEED * printer.max_speed_mm_s.e * area
    return compensate_lag(toolpath, measured_lag_s(load), rate).toolpath


def measured_lag_s(load: Filled) -> float:
    """The lag to compensate, s.

    Raises
    ------
    UsageError
        Where it isn't known for this ink, syringe and needle.
    """
    lag = lag_of(load.ink, load.syringe, load.needle, None)
    if lag.how == "unknown":
        raise UsageError(
            f"toolpath.compensate_lag: {lag.note.partition(':')[0]}; measure it and write it to "
            "the ink's profile (printctl calibrate lag --needle ... --write), or leave it out"
        )
    return lag.seconds


def relief_ul(load: Filled) -> float:
    """Plunger relief besides the compensation: no more than the ink's yield stress holds, µL.

    The compensation takes back all pressure that drives a flow; more would draw the bath in.
    """
    nozzle = nozzle_of(load.ink, load.needle, measured_lag_s(load), load.ink.plunger_ul_s)
    return min(load.ink.retract_ul, nozzle.held_ul)
