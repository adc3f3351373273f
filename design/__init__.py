"""Public names of the design side: tissue, vessel growth, flow, solids, toolpath, G-code.

`import design` gives what scripts and notebooks use, and docs/python.md shows. These names stay as
they are from one minor version to the next; what isn't named here may move. Each is loaded when
it is first asked for: a command that needs one room shouldn't wait for all.

Goes in: a tissue and options. Comes out: a network, its flow, solids and a toolpath. Begin with
`network.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from design.display import LAB, Units
    from design.errors import DesignError
    from design.hemodynamics import FlowConditions, FlowSolution, flow_summary, solve_flow
    from design.hemodynamics.zero_d.report import write_flow_csv
    from design.network import VesselKind, VesselNetwork
    from design.network_files.by_suffix import read_network, write_network
    from design.solids import (
        Solid,
        block_solid,
        construct_solid,
        lumen_solid,
        read_solid,
        solid_from_surface,
        write_3mf,
        write_stl,
    )
    from design.tissue import (
        Tissue,
        annulus,
        biventricle,
        block,
        cylinder,
        folded_cortex,
        kidney,
        load_tissue,
        tissue_from_surface,
    )
    from design.toolpath import MoveKind, Toolpath
    from design.toolpath.embedded import EmbeddedOptions, plan_embedded
    from design.toolpath.fresh import FreshOptions, plan_fresh
    from design.toolpath.gcode import Gcode, GcodeOptions, write_gcode
    from design.vasculature import (
        GrowthOptions,
        LoopOptions,
        RootSpec,
        VesselTree,
        check_network,
        close_loops,
        forest_to_network,
        grow_forest,
        grow_tree,
        planar_four_vessel,
        tree_to_network,
    )

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
    "kidney",
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

__getattr__, __dir__ = on_demand(__name__)
