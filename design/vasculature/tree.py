"""A grown tree: its geometry, its topology and its ratios, but never its radii."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]


@dataclass(frozen=True)
class VesselTree:
    """A binary tree of straight segments with equal terminal pressures.

    Radii follow from the ratios in one downward pass (`design.vasculature.radii`); a stored
    radius could contradict them.

    Attributes
    ----------
    proximal, distal : (n, 3) float64, mm
        Ends of each segment; segment 0 is the root.
    parent : (n,) int32
        -1 for the root.
    children : (n, 2) int32
        -1, -1 for a terminal.
    terminals : (n,) int32
        Terminals downstream, itself included.
    reduced_resistance : (n,) float64, Pa·s·mm
        R* = 8 μ ℓ / π + 1 / (β_l⁴ / R*_l + β_r⁴ / R*_r), so that R = R* / r⁴.
    ratio : (n,) float64
        β, this segment's radius over its parent's; 1 for the root.
    terminal_flow_ul_s : float, µL/s
        Flow of each terminal.
    pressure_drop_pa : float, Pa
        From the root's inlet to every terminal's outlet.
    murray_exponent : float
        γ.
    viscosity_pa_s : float, Pa·s
        μ.
    """

    proximal: FloatArray
    distal: FloatArray
    parent: IntArray
    children: NDArray[np.int32]
    terminals: IntArray
    reduced_resistance: FloatArray
    ratio: FloatArray
    terminal_flow_ul_s: float
    pressure_drop_pa: float
    murray_exponent: float
    viscosity_pa_s: float
