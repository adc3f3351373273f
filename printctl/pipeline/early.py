"""Refusals that network, needle and printer decide alone, before a path is planned."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from printctl.pipeline.context import RunContext
from printctl.preflight import needle_check
from printctl.set_up.check import Check, refuse_failed


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
    # Several heads stand apart from the carriage: their reach is looked at in the G-code.
    refuse_failed([*checks, *(() if context.printer.heads else _reach(context))])


def _reach(context: RunContext) -> Iterator[Check]:
    """Whether every point of the axes lies within the printer's travel."""
    points = context.written_network.points + context.place_mm
    printer = context.printer
    for axis, span in enumerate((printer.x_mm, printer.y_mm, printer.z_mm)):
        name = "xyz"[axis]
        low, high = float(points[:, axis].min()), float(points[:, axis].max())
        for value, limit, end in ((low, span.low, "low"), (high, span.high, "high")):
            yield Check(
                f"{'least' if end == 'low' else 'greatest'} {name} of the network",
                value,
                limit,
                "mm",
                bool(np.isfinite(value)) and (value >= limit if end == "low" else value <= limit),
                f"printer: {name}_mm.{end}",
                "place the part elsewhere (printer.place_mm)",
            )
