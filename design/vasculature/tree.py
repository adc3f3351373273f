"""Data class of a grown tree: segment geometry, topology, flows, radius ratios (no radii)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray

IntArray = NDArray[np.int32]


@dataclass(frozen=True)
class VesselTree:
    """A tree of straight segments with equal terminal pressures, two children at each joint.

    Radii follow from the ratios in one downward pass (`design.vasculature.treemath`); a stored
    radius could contradict them.

    Attributes
    ----------
    proximal, distal : (n, 3) float64, mm
        Ends of each segment; segment 0 is the root.
    parent : (n,) int32
        -1 for the root.
    children : (n, 2) int32
        -1, -1 for a terminal; the second alone is -1 where a given trunk bends.
    terminals : (n,) int32
        Terminals downstream, itself included.
    relative_flow : (n,) float64
        Flow over that of the mean terminal; with equal flows, ``terminals``.
    relative_viscosity : (n,) float64
        Viscosity over ``viscosity_pa_s``: 1, or by `haematocrit` at the segment's radius.
    reduced_resistance : (n,) float64, Pa·s·mm
        R* = 8 μ v ℓ / π + 1 / (β_l⁴ / R*_l + β_r⁴ / R*_r), so that R = R* / r⁴; v is the
        relative viscosity.
    ratio : (n,) float64
        β, this segment's radius over its parent's; 1 for the root.
    terminal_flow_ul_s : float, µL/s
        Mean flow of the terminals; with equal flows, of each.
    pressure_drop_pa : float, Pa
        From the root's inlet to every terminal's outlet.
    murray_exponent : float
        γ.
    viscosity_pa_s : float, Pa·s
        μ; with a haematocrit, in wide vessels.
    haematocrit : float
        Of Pries' law (`design.vasculature.viscosity`); below 0 for a Newtonian fluid.
    given : (n,) bool
        Segments of a given trunk, which stay where they are.
    notes : tuple of str
        What was chosen for the user while the tree grew.
    """

    proximal: FloatArray
    distal: FloatArray
    parent: IntArray
    children: NDArray[np.int32]
    terminals: IntArray
    relative_flow: FloatArray
    relative_viscosity: FloatArray
    reduced_resistance: FloatArray
    ratio: FloatArray
    terminal_flow_ul_s: float
    pressure_drop_pa: float
    murray_exponent: float
    viscosity_pa_s: float
    haematocrit: float
    given: NDArray[np.bool_]
    notes: tuple[str, ...] = ()

    @property
    def flow_ul_s(self) -> FloatArray:
        """Flow through each segment, (n,), µL/s."""
        return self.terminal_flow_ul_s * self.relative_flow
