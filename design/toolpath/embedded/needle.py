"""Needle geometry: radius to be kept free at each height above the tip; distance from the shaft."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from kernels import jit

JOINT: Final = math.sqrt(2.0)
"""Ink so many times tip and filament radius away along a vessel is a joint's: slopes of up to
45 degrees may join, and be written downward."""
ROUNDING_MM: Final = 0.002
"""A joint ends so much earlier in the plan: G-code is written to a micrometre, so a vessel that is
cut just at a joint's end may begin outside it in what is printed."""


class Needle(NamedTuple):
    """Geometry of a vertical needle.

    Attributes
    ----------
    joint_mm : float, mm
        Radius of the thinnest head's tip, by which joints reach.
    bare_mm : float, mm
        Radius of the widest head's tip.
    tip_mm, shaft_mm : float, mm
        Radius to be kept free at the tip, and around the shaft above the cone: with clearance.
    cone_mm : float, mm
        Height over which the one becomes the other; 0 for a plain tube.
    overlap_radii : float
        Overlap of joints, in radii.
    """

    joint_mm: float
    bare_mm: float
    tip_mm: float
    shaft_mm: float
    cone_mm: float
    overlap_radii: float

    def bare(self) -> Needle:
        """The needle itself, without its clearance."""
        return self._replace(
            tip_mm=self.bare_mm, shaft_mm=self.shaft_mm - self.tip_mm + self.bare_mm
        )

    def thinner(self, radius_mm: float) -> Needle:
        """The same with a tip of that bare radius, shaft and clearance following."""
        less = self.bare_mm - radius_mm
        return self._replace(
            joint_mm=min(self.joint_mm, radius_mm),
            bare_mm=radius_mm,
            tip_mm=self.tip_mm - less,
            shaft_mm=self.shaft_mm - less,
        )


@jit
def radius_at(needle: Needle, height: float) -> float:
    """Radius that must be free at a height above the tip, mm."""
    if height >= needle.cone_mm:
        return needle.shaft_mm
    return needle.tip_mm + (needle.shaft_mm - needle.tip_mm) * height / needle.cone_mm


@jit
def joint_reach(needle: Needle, radius: float) -> float:
    """How far along the network ink belongs to the place that is written, mm."""
    return JOINT * (needle.joint_mm + radius) + needle.overlap_radii * radius - ROUNDING_MM


@jit
def off_shaft(across: float, height: float, needle: Needle) -> float:
    """Signed distance from the shaft of a place so far from its axis and above its tip, mm.

    The shaft is convex: above its tip, within its radius, within the slant of its cone. Inside, the
    distance is below 0, to the nearest of these sides.
    """
    out = across - needle.tip_mm
    if needle.cone_mm <= 0.0:
        inside = max(out, -height)
        if inside <= 0.0:
            return inside
        return math.hypot(max(out, 0.0), min(height, 0.0))
    more, cone = needle.shaft_mm - needle.tip_mm, needle.cone_mm
    slant2 = more * more + cone * cone
    beside = (out * cone - height * more) / math.sqrt(slant2)
    inside = max(max(beside, across - needle.shaft_mm), -height)
    if inside <= 0.0:
        return inside
    share = min(max((out * more + height * cone) / slant2, 0.0), 1.0)
    near = math.hypot(out - share * more, height - share * cone)
    near = min(near, math.hypot(across - needle.shaft_mm, min(height - cone, 0.0)))
    return min(near, math.hypot(max(out, 0.0), height))


@jit
def off_shaft_slopes(across: float, height: float, needle: Needle) -> tuple[float, float, float]:
    """`off_shaft` (mm), and how it changes with either: its gradient, or at an edge one side's."""
    off = off_shaft(across, height, needle)
    out, more, cone = across - needle.tip_mm, needle.shaft_mm - needle.tip_mm, needle.cone_mm
    if off <= 0.0:
        if off == -height:
            return off, 0.0, -1.0
        if cone <= 0.0 or off == across - needle.shaft_mm:
            return off, 1.0, 0.0
        slant = math.sqrt(more * more + cone * cone)
        return off, cone / slant, -more / slant
    if cone <= 0.0:
        height = min(height, 0.0)
    if cone <= 0.0 or off == math.hypot(max(out, 0.0), height):
        return off, max(out, 0.0) / off, height / off
    over = min(height - cone, 0.0)
    if off == math.hypot(across - needle.shaft_mm, over):
        return off, (across - needle.shaft_mm) / off, over / off
    share = min(max((out * more + height * cone) / (more * more + cone * cone), 0.0), 1.0)
    return off, (out - share * more) / off, (height - share * cone) / off


@jit
def without_clearance(needle: Needle) -> Needle:
    """As `Needle.bare`, for kernels."""
    shaft = needle.shaft_mm - needle.tip_mm + needle.bare_mm
    return Needle(
        needle.joint_mm,
        needle.bare_mm,
        needle.bare_mm,
        shaft,
        needle.cone_mm,
        needle.overlap_radii,
    )
