"""Dye transport in a vessel network: front, concentration curves, and video frame-rate check."""

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
from design.hemodynamics.dye.transit_times import CarryingFlow, carried_by, downstream, ends_along

__all__ = [
    "CARRIED_BELOW",
    "DISPERSED_ABOVE",
    "DYE_DIFFUSIVITY",
    "CarryingFlow",
    "DyeFront",
    "FrameCheck",
    "carried_by",
    "check_frames",
    "downstream",
    "dye_curves",
    "dye_front",
    "ends_along",
    "front_table",
    "mean_age",
]
