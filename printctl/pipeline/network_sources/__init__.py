"""Sources of a recipe's vessel network: given, shipped, lattice, tree, organ, loops, forest.

Goes in: a run and the recipe's vasculature section. Comes out: the network in the design's size
and its entries for the report. Begin with `trees.py`. A source is loaded when a recipe asks for it.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from printctl.pipeline.network_sources.forest import forest_network
    from printctl.pipeline.network_sources.given import (
        given_network,
        lattice_network,
        shipped_network,
    )
    from printctl.pipeline.network_sources.loops import loop_network
    from printctl.pipeline.network_sources.organs import organ_network
    from printctl.pipeline.network_sources.trees import tree_network

__all__ = [
    "forest_network",
    "given_network",
    "lattice_network",
    "loop_network",
    "organ_network",
    "shipped_network",
    "tree_network",
]

__getattr__, __dir__ = on_demand(__name__)
