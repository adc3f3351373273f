"""Options of a mend: overlaps, clearances, tolerances, primes and wipes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.toolpath.priming import Purge
from printctl.observe.mending.errors import MendError


@dataclass(frozen=True)
class MendOptions:
    """How gaps are patched.

    Attributes
    ----------
    overlap_widths : float
        How far a patch begins and ends on sound ink, in widths of its line.
    merge_widths : float
        Gaps of a path nearer to each other are one.
    least_mm : float, mm
        Shorter stretches aren't worth a descent of the needle.
    void_tolerance_mm : float, mm
        How far ink may reach into a void, rounding of motor steps included.
    shift_mm : float, mm
        How far the patch may lie beside what was seen, added to the gap's own.
    clearance_mm : float, mm
        Kept between the needle and ink that stands in its way.
    lift_mm : float or None, mm
        Height of travels above all ink; None takes two layers, at least 0.2 mm, or 0.5 mm in a
        bath.
    wipe_widths : float
        Way on along sound ink with the plunger relieved, layers only.
    purge : Purge or None
        Place outside the part (printer's frame) to prime and wipe before the first patch; None
        primes as the job does after a travel, at the patch's beginning.
    room_for_second_pass : float
        Share of a layer's height that must be free above a thin stretch for a second pass.
    """

    overlap_widths: float = 1.0
    merge_widths: float = 2.0
    least_mm: float = 0.05
    void_tolerance_mm: float = 0.05
    shift_mm: float = 0.02
    clearance_mm: float = 0.05
    lift_mm: float | None = None
    wipe_widths: float = 1.0
    purge: Purge | None = None
    room_for_second_pass: float = 0.25

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            number = not isinstance(value, Purge) and value is not None
            if number and not (np.isfinite(value) and value >= 0):
                raise MendError(f"mends: {name} is {value:g}; give a number of 0 or more")

    def travel_lift_mm(self, layer_mm: float, *, layered: bool) -> float:
        """Height above all ink at which the needle travels, mm."""
        if self.lift_mm is not None:
            return self.lift_mm
        return max(0.2, 2 * layer_mm) if layered else 0.5
