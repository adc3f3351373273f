"""Refuse designs deeper than the needle or beyond the printer's travel, before path planning."""

from __future__ import annotations

from printctl.pipeline.context import RunContext
from printctl.pipeline.refusals import reach_checks
from printctl.preflight import needle_check
from printctl.set_up.check import refuse_failed


def refuse_early(context: RunContext) -> None:
    """Refuse a network that the needles or the printer can't reach.

    The same is asked of the G-code again, which knows of ways and overlaps too.

    Raises
    ------
    SafetyError
        With every check that failed.
    """
    low, high = context.written_bounds
    depth = float(high[2] - low[2])
    checks = [needle_check(depth, load.needle) for load in context.loads]
    if not context.printer.heads:
        # Several heads stand apart from the carriage: their reach is looked at in the G-code.
        points = context.written_network.points + context.place_mm
        checks += reach_checks(points, context.printer)
    refuse_failed(checks)
