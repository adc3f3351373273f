"""Predict a filament's fate in the bath: swelling, settling, open crevice behind the needle.

Settling. A horizontal cylinder of diameter D in a Bingham fluid carries F/L = 11.94 τ_y D before it
moves: 4√2 + 2π, the slip-line limit of a rough cylinder (Randolph & Houlsby, Géotechnique 34 (1984)
613; for a viscoplastic fluid Tokpavi, Magnin & Jay, J. Non-Newtonian Fluid Mech. 154 (2008) 65).
Its weight Δϱ g π D²/4 is held, so, up to D = τ_y / (0.066 Δϱ g), which is the 0.07 of the product's
check (`supported_diameter_mm`, Grosskopf et al. 2018), taken here too. What exceeds it
drives it against the plastic viscosity μ as in a Newtonian fluid, F/L = 4π μ U / ln(2L/D), slender
body to leading order (Batchelor, J. Fluid Mech. 44 (1970) 419). Adding both resistances is an
estimate, uncalibrated.

Trail. A bath that takes t_r to close leaves the needle's path open over v t_r behind it: the
crevice into which ink rises or air falls (Grosskopf et al., ACS Appl. Mater. Interfaces 10 (2018)
23353; Friedrich & Seppala, Soft Matter 17 (2021) 8027). It is open when that is longer than the
needle is thick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from firmware_profiles import Bath, Ink, Needle, supported_diameter_mm, weight_in_bath_n_m3
from kernels.arrays import FloatArray, IntArray
from sim.gcode.bead.predict import Bead

BEARS: Final = 4 * math.sqrt(2) + 2 * math.pi


@dataclass(frozen=True)
class FilamentHold:
    """Whether the thickest filament stays where it is written.

    Attributes
    ----------
    widest_mm, held_mm : float, mm
        Thickest that is predicted, and that the bath holds; infinite for equal densities.
    line : int
        Where it is written.
    up : bool
        Whether it would rise, not sink.
    speed_mm_s : float or None, mm/s
        How fast it sinks or rises at once; 0 where held, None where the bath's viscosity isn't
        known.
    """

    widest_mm: float
    held_mm: float
    line: int
    up: bool
    speed_mm_s: float | None

    @property
    def held(self) -> bool:
        """Whether it stays."""
        return self.widest_mm <= self.held_mm


@dataclass(frozen=True)
class Trail:
    """The needle's path that isn't closed yet.

    Attributes
    ----------
    length_mm : float, mm
        Behind the needle at its fastest in the bath's ink: v t_r.
    speed_mm_s : float, mm/s
    line : int
    opens : bool
        Whether it is longer than the needle is thick.
    """

    length_mm: float
    speed_mm_s: float
    line: int
    opens: bool


def swell(ink: Ink) -> tuple[float, bool]:
    """Factor of diameters in the bath, and whether it was measured; 1 where it wasn't."""
    return (1.0, False) if ink.swell_factor is None else (ink.swell_factor, ink.calibrated)


def settling(bead: Bead, ink: Ink, bath: Bath) -> FilamentHold | None:
    """Whether the bath holds the thickest filament; None where none is written, or in layers.

    A layer's lines rest on each other, and no single filament's law holds for them.
    """
    rows = np.flatnonzero(bead.writes & bead.lays)
    if bead.style == "layered" or not len(rows):
        return None
    worst = rows[int(bead.width_mm[rows].argmax())]
    wide = float(bead.width_mm[worst]) * swell(ink)[0]
    weight, held = weight_in_bath_n_m3(bath, ink), supported_diameter_mm(bath, ink)
    speed: float | None = 0.0
    if wide > held:
        own = bead.stroke == bead.stroke[worst]
        length = float(bead.pieces.length[own & bead.writes].sum())
        speed = _sinks(bath, abs(weight), wide, length)
    return FilamentHold(wide, held, int(bead.line[worst]), weight < 0, speed)


def _sinks(bath: Bath, weight_n_m3: float, wide_mm: float, length_mm: float) -> float | None:
    """Speed of a filament that isn't held, mm/s; None without the bath's viscosity."""
    if bath.viscosity_pa_s is None:
        return None
    metre = wide_mm * 1e-3
    left = weight_n_m3 * math.pi / 4 * metre**2 - BEARS * bath.yield_stress_pa * metre
    slender = math.log(max(2 * length_mm / wide_mm, math.e))
    return max(left, 0.0) * slender / (4 * math.pi * bath.viscosity_pa_s) * 1e3


def crevice(bead: Bead, needle: Needle, bath: Bath) -> Trail | None:
    """Trail behind the needle while it writes; None where the bath's recovery isn't known."""
    rows = np.flatnonzero(bead.writes & (bead.pieces.duration > 0))
    if bath.recovery_s is None or not len(rows):
        return None
    speed = bead.pieces.length[rows] / bead.pieces.duration[rows]
    worst = int(speed.argmax())
    length = float(speed[worst]) * bath.recovery_s
    line = int(bead.line[rows[worst]])
    return Trail(length, float(speed[worst]), line, length > needle.outer_mm)


# Roughly estimate the displacement of earlier ink by the passing needle shaft, to warn of it.
#
# A needle that moves through a yield-stress bath carries the bath beside it along; the yielded zone
# is about as wide as the needle (Grosskopf et al., ACS Appl. Mater. Interfaces 10 (2018) 23353;
# Friedrich & Seppala, Soft Matter 17 (2021) 8027). The displacement at a distance s from its
# surface is taken as R e^(−s/R), R the needle's outer radius: at most a radius at the surface, gone
# within a few radii. Neither the height nor the decay length was measured; so this ranks places and
# says nothing in micrometres. Ink that touches the filament being written (joints, neighbours in a
# layer) isn't counted.

REACH: Final = 3.0
"""Radii beyond the needle's surface that are looked at: e^-3 is 5 %."""
AT_ONCE: Final = 20_000
"""Places of the needle in one query, for the memory's sake."""


@dataclass(frozen=True)
class Drag:
    """The nearest passes of the shaft beside written ink.

    Attributes
    ----------
    worst_mm : float, mm
        Largest estimated displacement; 0 where the shaft passes nothing.
    line, dragged_line : int
        Lines that move the needle there, and that wrote the ink.
    places : int
        Pieces of ink passed within `REACH` radii.
    """

    worst_mm: float
    line: int
    dragged_line: int
    places: int


def drag(bead: Bead, needle_outer_mm: float) -> Drag:
    """Estimate how far the shaft pushes what other strokes wrote earlier, embedded writing only.

    Parameters
    ----------
    bead : Bead
    needle_outer_mm : float, mm
        The shaft stands vertical above the tip.
    """
    ink = np.flatnonzero(bead.lays & bead.writes)
    if bead.style == "layered" or not len(ink):
        return Drag(0.0, 0, 0, 0)
    radius = needle_outer_mm / 2
    place = (bead.pieces.start[ink] + bead.pieces.end[ink]) / 2
    tree = cKDTree(place[:, :2])
    needle = np.flatnonzero(bead.pieces.length > 1e-9)
    worst, lines, passed = 0.0, (0, 0), np.zeros(len(ink), bool)
    for first in range(0, len(needle), AT_ONCE):
        rows = needle[first : first + AT_ONCE]
        mover, met, gap = _passes(bead, tree, place, ink, rows, radius)
        passed[met] = True
        if not len(gap):
            continue
        nearest = int(gap.argmin())
        push = radius * float(np.exp(-gap[nearest] / radius))
        if push > worst:
            worst = push
            lines = (int(bead.line[mover[nearest]]), int(bead.line[ink[met[nearest]]]))
    return Drag(worst, *lines, int(passed.sum()))


def _passes(
    bead: Bead,
    tree: cKDTree,
    place: FloatArray,
    ink: IntArray,
    rows: IntArray,
    radius: float,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Pairs of a moving piece and earlier ink beside the shaft: both rows, and the gap, mm."""
    tip = (bead.pieces.start[rows] + bead.pieces.end[rows]) / 2
    near = tree.query_ball_point(tip[:, :2], (1 + REACH) * radius)
    count = np.array([len(some) for some in near], dtype=np.int64)
    met = np.concatenate([np.asarray(some, np.int64) for some in near])
    of = np.repeat(np.arange(len(rows)), count)
    mover, other = rows[of], ink[met]
    away = tip[of] - place[met]
    # Earlier ink of another stroke, at the tip's height or above it, that this one never touches.
    counts = (other < mover) & (bead.stroke[other] != bead.stroke[mover]) & (away[:, 2] <= radius)
    reach = (bead.width_mm[mover] + bead.width_mm[other]) / 2
    touches = (np.linalg.norm(away, axis=1) <= reach) & bead.writes[mover]
    pair = bead.stroke[mover] * len(bead) + other
    counts &= ~np.isin(pair, pair[touches])
    across = np.linalg.norm(away[:, :2], axis=1)[counts]
    return mover[counts], met[counts], np.maximum(across - radius, 0.0)
