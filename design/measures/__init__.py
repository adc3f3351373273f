"""Measure a vessel network (morphometry, paths, junctions) and its supply of the tissue.

Names are loaded when first used.

Goes in: a network, on request its tissue and flow. Comes out: measures of each vessel and of all.
Begin with `measure.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from design.measures.junctions import MurrayResiduals, TerminalFlow
    from design.measures.measure import (
        MeasureOptions,
        NetworkMeasures,
        measure_network,
        measures_dict,
    )
    from design.measures.morphometry import Morphometry, OrderTable
    from design.measures.paths import FlowPaths
    from design.measures.published_comparison import compare_orders
    from design.measures.supply import BEYOND_UM, Oxygen, OxygenModel, Supply

__all__ = [
    "BEYOND_UM",
    "FlowPaths",
    "MeasureOptions",
    "Morphometry",
    "MurrayResiduals",
    "NetworkMeasures",
    "OrderTable",
    "Oxygen",
    "OxygenModel",
    "Supply",
    "TerminalFlow",
    "compare_orders",
    "measure_network",
    "measures_dict",
]

__getattr__ = on_demand(__name__)


def __dir__() -> list[str]:
    return __all__
