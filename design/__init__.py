"""The design side: tissue, vasculature, network, hemodynamics, solids, toolpath.

`import design` gives what scripts and notebooks use: the names of `design.interface`, which
docs/python.md shows. Each is loaded when it is first asked for: a command that needs one room
shouldn't wait for all.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from design.interface import *

__all__ = [
    "LAB",
    "DesignError",
    "EmbeddedOptions",
    "FlowConditions",
    "FlowSolution",
    "FreshOptions",
    "Gcode",
    "GcodeOptions",
    "GrowthOptions",
    "LoopOptions",
    "MoveKind",
    "RootSpec",
    "Solid",
    "Tissue",
    "Toolpath",
    "Units",
    "VesselKind",
    "VesselNetwork",
    "VesselTree",
    "annulus",
    "biventricle",
    "block",
    "block_solid",
    "check_network",
    "close_loops",
    "construct_solid",
    "cylinder",
    "flow_summary",
    "folded_cortex",
    "forest_to_network",
    "grow_forest",
    "grow_tree",
    "load_tissue",
    "lumen_solid",
    "plan_embedded",
    "plan_fresh",
    "planar_four_vessel",
    "read_network",
    "read_solid",
    "solid_from_surface",
    "solve_flow",
    "tissue_from_surface",
    "tree_to_network",
    "write_3mf",
    "write_flow_csv",
    "write_gcode",
    "write_network",
    "write_stl",
]


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(import_module("design.interface"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
