"""Measure an aligned scan: surface deviation, vessel sections, defects, flow as printed.

Names are loaded when first asked for.

Goes in: an aligned scan and the design's network. Comes out: sections, diameters and defects.
Begin with `trace.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from registration.measuring.gauging.changes import drop_edge_changes, find_changes
    from registration.measuring.gauging.closures import Ends, find_closures
    from registration.measuring.gauging.defect import Defect
    from registration.measuring.gauging.design_to_scan import ScannedSurface, surface_points
    from registration.measuring.gauging.designed import with_designed_walls
    from registration.measuring.gauging.deviation import (
        TOLERANCES_UM,
        Deviation,
        deviations,
        hausdorff_p95_um,
        summarise,
    )
    from registration.measuring.gauging.junctions import find_junction_changes
    from registration.measuring.gauging.openings.mouths import with_mouths
    from registration.measuring.gauging.perfusion import (
        MeasuredLumen,
        Perfusion,
        connected_vessels,
        drop_dead_ends,
        network_of_lumens,
        printed_network,
        sub_network,
        with_interval,
        with_printed_lengths,
    )
    from registration.measuring.gauging.trace import VesselTrace, trace_vessels
    from registration.measuring.gauging.vessels import (
        VesselGauge,
        gauge_vessels,
        without_resistance,
    )
    from registration.measuring.gauging.walls.gel_like import (
        ContrastGauge,
        liquid_level,
        withdraw_sections,
        without_gel_like,
    )
    from registration.measuring.gauging.walls.own_levels import with_own_levels
    from registration.measuring.gauging.walls.wall_profile import with_told_walls

__all__ = [
    "TOLERANCES_UM",
    "ContrastGauge",
    "Defect",
    "Deviation",
    "Ends",
    "MeasuredLumen",
    "Perfusion",
    "ScannedSurface",
    "VesselGauge",
    "VesselTrace",
    "connected_vessels",
    "deviations",
    "drop_dead_ends",
    "drop_edge_changes",
    "find_changes",
    "find_closures",
    "find_junction_changes",
    "gauge_vessels",
    "hausdorff_p95_um",
    "liquid_level",
    "network_of_lumens",
    "printed_network",
    "sub_network",
    "summarise",
    "surface_points",
    "trace_vessels",
    "with_designed_walls",
    "with_interval",
    "with_mouths",
    "with_own_levels",
    "with_printed_lengths",
    "with_told_walls",
    "withdraw_sections",
    "without_gel_like",
    "without_resistance",
]

__getattr__, __dir__ = on_demand(__name__)
