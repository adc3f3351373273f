"""FRESH: layers of lines in a support bath, with the lumens kept open."""

from design.toolpath.fresh.compensate import Compensation
from design.toolpath.fresh.lumens import check_lumens
from design.toolpath.fresh.options import DENSEST_GYROID, Filling, FreshOptions, Infill
from design.toolpath.fresh.plan import FreshLayers, FreshPlan, fresh_toolpath, plan_fresh
from design.toolpath.fresh.regions import Region
from design.toolpath.fresh.report import FreshReport

__all__ = [
    "DENSEST_GYROID",
    "Compensation",
    "Filling",
    "FreshLayers",
    "FreshOptions",
    "FreshPlan",
    "FreshReport",
    "Infill",
    "Region",
    "check_lumens",
    "fresh_toolpath",
    "plan_fresh",
]
