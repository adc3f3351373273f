"""Weight of an ink in a yield-stress bath, and the thickest filament that the bath supports."""

from __future__ import annotations

import math
from typing import Final

from firmware_profiles.materials import Bath, Ink

GRAVITY: Final = 9.81  # m/s²
HELD: Final = 0.07
"""Yield stress over (density difference × g × diameter) at which a horizontal filament stays."""


def weight_in_bath_n_m3(bath: Bath, ink: Ink) -> float:
    """Weight of the ink less that of the bath in its place, N/m³; below 0 where it floats."""
    return (ink.density_g_cm3 - bath.density_g_cm3) * 1e3 * GRAVITY


def supported_diameter_mm(bath: Bath, ink: Ink) -> float:
    """Thickest horizontal filament of an ink that neither sinks nor floats, mm.

    Infinite without a difference of densities.
    D = τ_y / (0.07 Δρ g), Δρ between ink and bath: Grosskopf et al., ACS Appl. Mater. Interfaces 10
    (2018) 23353; Friedrich & Gunther. It is statics: the crevice behind the needle, surface tension
    and the bath's recovery limit more, and are no part of it.
    """
    weight = abs(weight_in_bath_n_m3(bath, ink))
    return math.inf if weight == 0 else bath.yield_stress_pa / (HELD * weight) * 1e3
