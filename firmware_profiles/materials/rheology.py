"""Pressure from flow, and flow from pressure, of a Herschel–Bulkley ink in a needle.

Laminar, steady, no slip at the wall, entry losses left out. The ink is a Herschel–Bulkley fluid,
τ = τ_y + K γ̇ⁿ; without a yield stress a power law, at n = 1 besides Newtonian. With the wall's
stress τ_w = Δp d / (4 L), R = d/2 and φ = τ_y/τ_w,

    Q = π R³ n (τ_w/K)^(1/n) (1−φ)^((n+1)/n) [(1−φ)²/(3n+1) + 2φ(1−φ)/(2n+1) + φ²/(n+1)]

for φ < 1, else nothing flows (Chhabra & Richardson, Non-Newtonian Flow and Applied Rheology, 2nd
ed. 2008, section 3.2.4). At φ = 0 it is Q = π R³ n/(3n+1) (τ_w/K)^(1/n), at n = 1 Hagen and
Poiseuille's Δp = 128 η L Q / (π d⁴). Lengths are in mm, volumes in µL, stresses in Pa.
"""

from __future__ import annotations

import math
from typing import Final

from firmware_profiles.materials.inks_and_baths import Ink
from firmware_profiles.tools import Needle

_HALVINGS: Final = 200


def flow_at_wall_stress(ink: Ink, bore_mm: float, stress_pa: float) -> float:
    """Flow at which the ink's stress at the needle's wall is ``stress_pa``, µL/s."""
    if stress_pa <= ink.yield_stress_pa:
        return 0.0
    n, phi = ink.flow_index, ink.yield_stress_pa / stress_pa
    sheared = 1.0 - phi
    profile = (
        sheared**2 / (3 * n + 1) + 2 * phi * sheared / (2 * n + 1) + phi**2 / (n + 1)
    ) * sheared ** ((n + 1) / n)
    rate = (stress_pa / ink.viscosity_pa_s) ** (1 / n)
    return float(math.pi * (bore_mm / 2) ** 3 * n * rate * profile)


def wall_stress_pa(ink: Ink, bore_mm: float, flow_ul_s: float) -> float:
    """Shear stress at the needle's wall, Pa; the yield stress where nothing flows.

    A power law has it in closed form, K ((3n + 1)/n · Q/(πR³))ⁿ; above a yield stress it lies
    between that and that with the yield stress added, and is found by halving.
    """
    n = ink.flow_index
    rate = (3 * n + 1) / n * flow_ul_s / (math.pi * (bore_mm / 2) ** 3)
    without = float(ink.viscosity_pa_s * rate**n)
    if ink.yield_stress_pa == 0 or flow_ul_s == 0:
        return max(without, ink.yield_stress_pa)
    # Twice the power law's and two yield stresses is above it for every n of the schema.
    low, high = ink.yield_stress_pa, 2 * (without + 2 * ink.yield_stress_pa)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if not low < middle < high:
            break
        if flow_at_wall_stress(ink, bore_mm, middle) < flow_ul_s:
            low = middle
        else:
            high = middle
    return high


def pressure_pa(ink: Ink, needle: Needle, flow_ul_s: float) -> float:
    """Pressure that drives a flow through the needle, Pa: 4 τ_w L / d."""
    stress = wall_stress_pa(ink, needle.inner_mm, flow_ul_s)
    return 4 * stress * needle.length_mm / needle.inner_mm


def flow_ul_s(ink: Ink, needle: Needle, pressure_pa: float) -> float:
    """Flow that a pressure drives through the needle, µL/s; 0 below `yield_pressure_pa`."""
    stress = pressure_pa * needle.inner_mm / (4 * needle.length_mm)
    return flow_at_wall_stress(ink, needle.inner_mm, stress)


def yield_pressure_pa(ink: Ink, needle: Needle) -> float:
    """Pressure that a yield stress holds in the needle when all stands, Pa: 4 τ_y L / d.

    Less than this doesn't start a flow, and this much stays behind the ink after a stop.
    """
    return 4 * ink.yield_stress_pa * needle.length_mm / needle.inner_mm
