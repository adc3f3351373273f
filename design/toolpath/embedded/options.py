"""Options of embedded writing along centrelines: needle, clearance, speeds, flow, overlaps."""

from __future__ import annotations

import math
from dataclasses import dataclass

from design.errors import ToolpathError
from design.toolpath.toolpath import check_fields
from firmware_profiles.tools import THINNEST_BORE


@dataclass(frozen=True)
class EmbeddedOptions:
    """Choices for writing filaments inside a yield-stress bath.

    Attributes
    ----------
    needle_inner_mm, needle_outer_mm : float, mm
        Diameters of the needle, a vertical tube.
    tip_outer_mm, cone_mm : float, mm
        Of a tapered tip: its outer diameter at the opening, and the height over which it widens to
        `needle_outer_mm`. 0 and 0 for a plain tube.
    clearance_mm : float, mm
        Kept between the shaft and what is written.
    thinnest : float
        Thinnest filament, as a part of the needle's inner diameter; thinner ones would have to
        be drawn out, and tear. A starting value, not measured.
    write_speed_mm_s, min_speed_mm_s : float, mm/s
        Fastest and slowest writing.
    max_flow_ul_s : float, µL/s
        Thick vessels are written slower so that the flow stays below it.
    travel_speed_mm_s, lift_speed_mm_s : float, mm/s
        Above everything written, and going up or down.
    lift_mm : float, mm
        Height of a travel above everything written.
    overlap_radii : float
        Overlap of a joint in radii of the thinner vessel of the two that meet.
    retract_ul : float, µL
        Plunger relief at the end of a pass; the same volume primes the next.
    plunger_ul_s : float, µL/s
        Flow while priming and retracting.
    dwell_s : float, s
        Pause after a prime, until the ink flows.
    open_joints : int
        How many joints may stay without an overlap; more are refused.
    leave_out : bool
        Whether vessels that the needle can't write without entering others, or being entered by
        them, in any order are left out and named; else they are written, and the crossings named.
    recovery_s : float, s
        How long the bath takes to close behind the needle; no pass is begun in a younger wake.
    look_within : bool
        Whether passes name places to look at what was written before the rest bars a mend of it.
    widest_filament_mm : float or None, mm
        Wider vessels are asked for as strands (`bundles`); None for what `largest_lumen_mm` says.
    """

    needle_inner_mm: float = 0.16
    needle_outer_mm: float = 0.31
    tip_outer_mm: float = 0.0
    cone_mm: float = 0.0
    clearance_mm: float = 0.05
    thinnest: float = THINNEST_BORE
    write_speed_mm_s: float = 5.0
    min_speed_mm_s: float = 0.2
    max_flow_ul_s: float = 2.0
    travel_speed_mm_s: float = 20.0
    lift_speed_mm_s: float = 5.0
    lift_mm: float = 1.0
    overlap_radii: float = 0.0
    retract_ul: float = 0.02
    plunger_ul_s: float = 0.4
    dwell_s: float = 0.0
    open_joints: int = 0
    leave_out: bool = False
    recovery_s: float = 0.0
    look_within: bool = False
    widest_filament_mm: float | None = None

    def __post_init__(self) -> None:
        check_fields(
            "embedded options",
            self,
            "needle_inner_mm needle_outer_mm thinnest write_speed_mm_s min_speed_mm_s "
            "max_flow_ul_s travel_speed_mm_s lift_speed_mm_s lift_mm plunger_ul_s",
            "clearance_mm overlap_radii retract_ul dwell_s tip_outer_mm cone_mm open_joints "
            "recovery_s",
        )
        if (self.tip_outer_mm > 0) != (self.cone_mm > 0):
            raise ToolpathError(
                f"tip_outer_mm {self.tip_outer_mm:g} and cone_mm {self.cone_mm:g} (embedded "
                "options) describe a tapered tip together; give both or neither"
            )
        for small, large in (
            ("needle_inner_mm", "needle_outer_mm"),
            ("tip_outer_mm", "needle_outer_mm"),
            ("min_speed_mm_s", "write_speed_mm_s"),
        ):
            if getattr(self, small) > getattr(self, large):
                raise ToolpathError(
                    f"{small} {getattr(self, small):g} is above {large} {getattr(self, large):g} "
                    "(embedded options); lower the first or raise the second"
                )

    @property
    def shaft_mm(self) -> float:
        """Radius that must stay free around the shaft, mm."""
        return self.needle_outer_mm / 2 + self.clearance_mm

    @property
    def tip_mm(self) -> float:
        """Radius that must stay free around the tip, mm."""
        return (self.tip_outer_mm or self.needle_outer_mm) / 2 + self.clearance_mm

    @property
    def smallest_lumen_mm(self) -> float:
        """Thinnest filament, mm: ``thinnest`` times the needle's bore."""
        return self.thinnest * self.needle_inner_mm

    def smallest_wall_mm(self, thinnest_radius_mm: float) -> float:
        """Thinnest wall between two filaments, mm, of which none is thinner than a radius.

        The needle's tip, wider than what it writes, mustn't touch the filament beside it.
        """
        return max(self.clearance_mm, self.shaft_mm - thinnest_radius_mm)

    @property
    def largest_lumen_mm(self) -> float:
        """Thickest filament, mm: what `max_flow_ul_s` fills at `min_speed_mm_s`."""
        return math.sqrt(4 * self.max_flow_ul_s / (math.pi * self.min_speed_mm_s))

    @property
    def widest_mm(self) -> float:
        """Diameter of the widest filament, mm, from which on a vessel is a bundle of strands."""
        return min(self.widest_filament_mm or math.inf, self.largest_lumen_mm)
