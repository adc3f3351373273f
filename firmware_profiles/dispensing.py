"""Flow rate of ink from a pneumatic head: as weighed at this pressure, else by its rheology."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_profiles.dispensers import Pneumatic
from firmware_profiles.errors import ProfileError
from firmware_profiles.materials import Ink
from firmware_profiles.rheology import flow_ul_s, yield_pressure_pa
from firmware_profiles.tools import Needle


@dataclass(frozen=True)
class SteadyFlow:
    """Flow rate while the valve is open.

    Attributes
    ----------
    ul_s : float, µL/s
        What comes out.
    measured : bool
        By weight, at this pressure with this ink and needle; else it is foreseen from the ink's
        viscosity.
    """

    ul_s: float
    measured: bool


def steady_flow(head: Pneumatic, ink: Ink, needle: Needle) -> SteadyFlow:
    """Flow through the needle at the head's pressure, times the ink's flow factor if foreseen.

    Raises
    ------
    ProfileError
        When the pressure doesn't overcome the ink's yield stress.
    """
    measured = head.measured
    fits = measured is not None and (measured.ink, measured.needle) == (ink.name, needle.name)
    if measured is not None and fits and measured.pressure_kpa == head.pressure_kpa:
        return SteadyFlow(measured.flow_ul_s, True)
    flow = flow_ul_s(ink, needle, head.pressure_kpa * 1e3) * ink.flow_factor
    if flow <= 0:
        raise ProfileError(
            f"{head.pressure_kpa:g} kPa (dispenser: pressure_kpa) don't move {ink.name} through "
            f"{needle.name}: its yield stress holds "
            f"{yield_pressure_pa(ink, needle) * 1e-3:.4g} kPa; "
            "raise the pressure, or take a wider or shorter needle"
        )
    return SteadyFlow(flow, False)
