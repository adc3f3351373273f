"""Measure a vessel network (morphometry, paths, junctions) and its supply of the tissue.

Names are loaded when first used.

Goes in: a network, on request its tissue and flow. Comes out: measures of each vessel and of all.
Begin with `measure.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from design.measures.measure import (
        MeasureOptions,
        measure_network,
        measures_dict,
    )
    from design.measures.published_comparison import compare_orders
    from design.measures.supply import OxygenModel, Supply

__all__ = [
    "MeasureOptions",
    "OxygenModel",
    "Supply",
    "compare_orders",
    "measure_network",
    "measures_dict",
]

__getattr__, __dir__ = on_demand(__name__)
