"""Compute each vessel's inertance: pressure drop per rate of change of flow."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.hemodynamics.vessel.geometry import integral_of_power
from design.network import VesselNetwork
from design.units import WATER_DENSITY
from kernels.arrays import FloatArray

PARABOLIC: Final = 4.0 / 3.0
"""Momentum of a parabolic profile over that of a plug: the limit of low Womersley numbers, where
Womersley's impedance is R + iω (4/3) ϱℓ/(πr²)."""


def plug_inertance(network: VesselNetwork, density: float = WATER_DENSITY) -> FloatArray:
    """ϱ ∫ ds/(π r²) of each vessel, (v,), Pa·s²/µL; ``density`` in Pa·s²/mm²."""
    return density / np.pi * integral_of_power(network, -2)
