"""Refuse designs deeper than the needle or beyond the printer's travel, before path planning."""

from __future__ import annotations

import numpy as np

from printctl.checks.preflight import needle_check
from printctl.checks.set_up import refuse_failed
from printctl.pipeline.context import RunContext
from printctl.pipeline.refusals import reach_checks
from printctl.recipe.making import Embedded


def refuse_early(context: RunContext) -> None:
    """Refuse what the needles or the printer can't reach: an embedded network, layers of a part.

    The same is asked of the G-code again, which knows of ways and overlaps too.

    Raises
    ------
    SafetyError
        With every check that failed.
    """
    bounds, checks = context.written_bounds, []
    embedded = isinstance(context.recipe.toolpath, Embedded)
    if embedded:
        depth = float(np.ptp(bounds[:, 2]))
        checks += [needle_check(depth, load.needle) for load in context.loads]
    if not context.printer.heads:
        # Several heads stand apart from the carriage: their reach is looked at in the G-code.
        points, what = (context.written_network.points, "network") if embedded else (bounds, "part")
        checks += reach_checks(points + context.place_mm, context.printer, what)
    refuse_failed(checks)
