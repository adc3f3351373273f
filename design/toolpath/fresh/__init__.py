"""Slice solids into FRESH layers of lines in a support bath, with the lumens kept open.

Goes in: a solid and options. Comes out: layers of moves and a report. Begin with `plan.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from design.toolpath.fresh.options import (
        DENSEST_GYROID,
        Adaptive,
        Compensation,
        Filling,
        FreshOptions,
        Infill,
    )
    from design.toolpath.fresh.plan import FreshLayers, plan_fresh
    from design.toolpath.fresh.report import FreshReport
    from design.toolpath.fresh.section import Region, check_lumens

__all__ = [
    "DENSEST_GYROID",
    "Adaptive",
    "Compensation",
    "Filling",
    "FreshLayers",
    "FreshOptions",
    "FreshReport",
    "Infill",
    "Region",
    "check_lumens",
    "plan_fresh",
]

__getattr__, __dir__ = on_demand(__name__)
