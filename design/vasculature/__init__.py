"""Grow vessel trees in a tissue, join them to loops, find collisions; an example network.

Goes in: a tissue and options. Comes out: a `VesselTree` or a `VesselNetwork`. Begin with
`tree.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from design.vasculature.collide import check_given_once, check_network, collisions
    from design.vasculature.growth.forest import RootSpec, forest_to_network, grow_forest
    from design.vasculature.growth.parts import (
        Inlet,
        grow_parts,
        parts_to_network,
        terminals_of,
    )
    from design.vasculature.growth.printable import grow_printable
    from design.vasculature.growth.supply import (
        check_parts,
        check_supply,
        supply_balance,
    )
    from design.vasculature.growth.threads import ClusterPool
    from design.vasculature.growth.tree import grow_tree, place_root
    from design.vasculature.loops.loops import ClosedLoops, LoopOptions, close_loops
    from design.vasculature.loops.mixing import JoinedTrees, join_forest, mix_trees
    from design.vasculature.named import (
        PLANAR_DIMPLES,
        Dimple,
        planar_four_vessel,
    )
    from design.vasculature.options import GrowthOptions, GrowthStage
    from design.vasculature.penalty import DepthPenalty
    from design.vasculature.tree import VesselTree
    from design.vasculature.treemath import (
        scaled_to_smallest_radius,
        tree_from_topology,
        tree_radii,
        tree_to_network,
    )

__all__ = [
    "PLANAR_DIMPLES",
    "ClosedLoops",
    "ClusterPool",
    "DepthPenalty",
    "Dimple",
    "GrowthOptions",
    "GrowthStage",
    "Inlet",
    "JoinedTrees",
    "LoopOptions",
    "RootSpec",
    "VesselTree",
    "check_given_once",
    "check_network",
    "check_parts",
    "check_supply",
    "close_loops",
    "collisions",
    "forest_to_network",
    "grow_forest",
    "grow_parts",
    "grow_printable",
    "grow_tree",
    "join_forest",
    "mix_trees",
    "parts_to_network",
    "place_root",
    "planar_four_vessel",
    "scaled_to_smallest_radius",
    "supply_balance",
    "terminals_of",
    "tree_from_topology",
    "tree_radii",
    "tree_to_network",
]

__getattr__, __dir__ = on_demand(__name__)
