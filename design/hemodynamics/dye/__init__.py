"""Predict dye arrival times and concentrations in a network; check a video's frame interval.

Goes in: a network and its steady flow. Comes out: arrival times and concentration curves. Begin
with `front.py`.
"""

from design.hemodynamics.dye.curves import dye_curves
from design.hemodynamics.dye.frames import FrameCheck, check_frames
from design.hemodynamics.dye.front import (
    CARRIED_BELOW,
    DISPERSED_ABOVE,
    DYE_DIFFUSIVITY,
    DyeFront,
    dye_front,
    front_table,
    mean_age,
)
from design.hemodynamics.dye.transit_times import (
    CarryingFlow,
    downstream_order,
    flow_ends,
    steady_transit,
)

__all__ = [
    "CARRIED_BELOW",
    "DISPERSED_ABOVE",
    "DYE_DIFFUSIVITY",
    "CarryingFlow",
    "DyeFront",
    "FrameCheck",
    "check_frames",
    "downstream_order",
    "dye_curves",
    "dye_front",
    "flow_ends",
    "front_table",
    "mean_age",
    "steady_transit",
]
