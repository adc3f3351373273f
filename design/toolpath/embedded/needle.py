"""Needle geometry: radius to be kept free at each height above the tip; distance from the shaft."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.errors import ToolpathError
from design.network import VesselNetwork
from design.toolpath.embedded.options import EmbeddedOptions
from kernels import jit
from kernels.arrays import FloatArray, IntArray

JOINT: Final = math.sqrt(2.0)
"""Ink so many times tip and filament radius away along a vessel is a joint's: slopes of up to
45 degrees may join, and be written downward."""
ROUNDING_MM: Final = 0.002
"""G-code is written to a micrometre: a joint ends so much earlier in the plan, as a vessel that is
cut just at its end may begin outside it in what is printed."""


class Needle(NamedTuple):
    """Geometry of a vertical needle."""

    joint_mm: float  # mm, radius of the thinnest head's tip, by which joints reach
    bare_mm: float  # mm, radius of the widest head's tip
    tip_mm: float  # mm, radius to be kept free at the tip: with clearance
    shaft_mm: float  # mm, the same around the shaft above the cone
    cone_mm: float  # mm, height over which the one becomes the other; 0 for a plain tube
    overlap_radii: float  # overlap of joints, in radii

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


@dataclass(frozen=True)
class EmbeddedHeads:
    """Heads of an embedded job, one or several.

    Attributes
    ----------
    options : tuple of EmbeddedOptions
        Of each head: its needle, its ink's relief, its speeds.
    vessel_head : (n,) int64
        The head of each vessel of the network.

    Raises
    ------
    ToolpathError
        For a vessel whose head isn't there.
    """

    options: tuple[EmbeddedOptions, ...]
    vessel_head: IntArray

    def __post_init__(self) -> None:
        wrong = np.flatnonzero((self.vessel_head < 0) | (self.vessel_head >= len(self.options)))
        if len(wrong):
            raise ToolpathError(
                f"vessel {int(wrong[0])} is given to head {int(self.vessel_head[wrong[0]])}; there "
                f"are {len(self.options)} (0 to {len(self.options) - 1})"
            )

    @staticmethod
    def one(options: EmbeddedOptions, network: VesselNetwork) -> EmbeddedHeads:
        """A single head writes all."""
        return EmbeddedHeads((options,), np.zeros(len(network.vessel_nodes), dtype=np.int64))

    def of(self, vessel: int) -> int:
        """The head that writes a vessel."""
        return int(self.vessel_head[vessel])

    @property
    def shaft_mm(self) -> float:
        """Radius that must stay free around any head's shaft, mm."""
        return max(one.shaft_mm for one in self.options)

    @property
    def bare_mm(self) -> tuple[float, float]:
        """Radius of the thinnest and of the widest head's tip, mm."""
        radii = [one.tip_mm - one.clearance_mm for one in self.options]
        return min(radii), max(radii)

    @property
    def tip_mm(self) -> float:
        """Radius that must stay free around any head's tip, mm."""
        return max(one.tip_mm for one in self.options)

    @property
    def cone_mm(self) -> float:
        """Height over which the tip widens to the shaft, mm; the shortest of all heads'."""
        return min(one.cone_mm for one in self.options)

    @property
    def leave_out(self) -> bool:
        """Whether vessels that can't be written without a crossing are left out."""
        return all(one.leave_out for one in self.options)

    @property
    def look_within(self) -> bool:
        """Whether passes name places to look."""
        return any(one.look_within for one in self.options)

    def needles(self) -> tuple[Needle, ...]:
        """Each head's needle without its clearance."""
        joint, widest = self.bare_mm
        return tuple(
            Needle(
                joint,
                widest,
                one.tip_mm - one.clearance_mm,
                one.shaft_mm - one.clearance_mm,
                one.cone_mm,
                self.overlap_radii,
            )
            for one in self.options
        )

    @property
    def overlap_radii(self) -> float:
        """The longest overlap of a joint, in radii."""
        return max(one.overlap_radii for one in self.options)

    def check(self, network: VesselNetwork) -> None:
        """Refuse vessels that their own head's needle can't write."""
        for number, options in enumerate(self.options):
            check_vessels(network, options, np.flatnonzero(self.vessel_head == number))


NAMED: Final = 5
"""Vessels that a message names, the thinnest first; the others are counted."""


def frustum_ul(points: FloatArray, radius: FloatArray) -> FloatArray:
    """Volume of each stretch of a tapered filament, (k - 1,), µL: π L (r₀² + r₀ r₁ + r₁²) / 3."""
    length = np.linalg.norm(np.diff(points, axis=0), axis=1)
    start, end = radius[:-1], radius[1:]
    return np.pi / 3.0 * length * (start**2 + start * end + end**2)


def writing_speed(area_mm2: FloatArray, options: EmbeddedOptions) -> FloatArray:
    """Speed of each stretch, mm/s: as fast as speed and flow limits allow, Q = A v."""
    return np.minimum(options.write_speed_mm_s, options.max_flow_ul_s / area_mm2)


def check_vessels(
    network: VesselNetwork, options: EmbeddedOptions, vessels: IntArray | None = None
) -> None:
    """Refuse vessels that the needle can't write; all of them, or some (``vessels``).

    Raises
    ------
    ToolpathError
        As `check_thinnest`, and for the thickest vessel whose flow exceeds `max_flow_ul_s` even
        at `min_speed_mm_s`.
    """
    check_thinnest(network, options, vessels)
    _check_thickest(network, options, _looked_at(network, vessels))


def _looked_at(network: VesselNetwork, vessels: IntArray | None) -> NDArray[np.bool_]:
    every = np.arange(network.vessel_count)
    return np.ones(len(every), np.bool_) if vessels is None else np.isin(every, vessels)


def check_thinnest(
    network: VesselNetwork,
    options: EmbeddedOptions,
    vessels: IntArray | None = None,
    needles: Mapping[str, float] | None = None,
) -> None:
    """Refuse vessels thinner than the needle writes; of all of them, or of some (``vessels``).

    Parameters
    ----------
    needles : mapping of str to float, mm
        Bores of needles that may be had, by name; without them only the bore needed is named.

    Raises
    ------
    ToolpathError
        Naming the thinnest of them, where it is, and what would write it.
    """
    thinnest = 2 * np.minimum.reduceat(network.radius, network.offset[:-1])
    looked_at = _looked_at(network, vessels)
    limit = options.smallest_lumen_mm
    thin = np.flatnonzero((thinnest < limit * (1 - 1e-9)) & looked_at)
    if len(thin):
        thin = thin[np.argsort(thinnest[thin], kind="stable")]
        vessel = int(thin[0])
        scale = np.ceil(100 * limit / thinnest[vessel]) / 100
        bore = float(thinnest[vessel]) / options.thinnest
        raise ToolpathError(
            f"vessel {vessel}: diameter {thinnest[vessel]:.3f} mm at "
            f"{_thinnest_at(network, vessel)} is thinner than {limit:.3f} mm, "
            f"{options.thinnest:g} × the needle's inner diameter of "
            f"{options.needle_inner_mm:g} mm (needle_inner_mm; {len(thin)} such vessels: "
            f"{_named(thin, thinnest)}); {_finer_needle(bore, needles or {})}, print it larger "
            f"(print_scale in a recipe: {scale:g} times as large as now), or "
            "let filaments be drawn thinner than the bore (toolpath.thinnest_bore in a recipe)"
        )


def _thinnest_at(network: VesselNetwork, vessel: int) -> str:
    low, high = network.offset[vessel : vessel + 2]
    at = network.points[low + int(np.argmin(network.radius[low:high]))]
    return "({:.4g}, {:.4g}, {:.4g}) mm".format(*at.tolist())


def _finer_needle(bore_mm: float, needles: Mapping[str, float]) -> str:
    """What needle writes it: the widest that does, or that none of them does."""
    fine = {name: bore for name, bore in needles.items() if bore <= bore_mm * (1 + 1e-9)}
    if fine:
        name = max(fine, key=lambda one: fine[one])
        return f"use a needle of at most {bore_mm:.3f} mm bore ({name}: {fine[name]:g} mm)"
    if not needles:
        return f"use a needle of at most {bore_mm:.3f} mm bore"
    name = min(needles, key=lambda one: needles[one])
    return (
        f"it takes a bore of at most {bore_mm:.3f} mm, and no shipped needle is that fine "
        f"({name}: {needles[name]:g} mm); widen these vessels"
    )


def _check_thickest(
    network: VesselNetwork, options: EmbeddedOptions, looked_at: NDArray[np.bool_]
) -> None:
    thickest = 2 * np.maximum.reduceat(network.radius, network.offset[:-1]) * looked_at
    limit = options.largest_lumen_mm
    thick = np.flatnonzero(thickest > limit * (1 + 1e-9))
    if len(thick):
        vessel = int(np.argmax(thickest))
        raise ToolpathError(
            f"vessel {vessel}: diameter {thickest[vessel]:.3f} mm is thicker than {limit:.3f} mm, "
            f"which {options.max_flow_ul_s:g} µL/s (max_flow_ul_s) fill at "
            f"{options.min_speed_mm_s:g} mm/s (min_speed_mm_s; {len(thick)} such vessels: "
            f"{_named(thick, thickest)}); allow more flow or less speed"
        )


def _named(vessels: IntArray, diameter_mm: FloatArray) -> str:
    """The first few vessels with their diameters, and how many more."""
    named = ", ".join(f"{k} ({diameter_mm[k]:.3f} mm)" for k in vessels[:NAMED].tolist())
    return named + (f" and {len(vessels) - NAMED} more" if len(vessels) > NAMED else "")
