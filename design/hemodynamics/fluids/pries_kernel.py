"""Compute Pries' relative blood viscosity for an array of vessel radii (compiled)."""

from __future__ import annotations

from design.vasculature.viscosity import relative_viscosity
from kernels import jit
from kernels.arrays import FloatArray


@jit
def relative(radius: FloatArray, haematocrit: float, viscosity: FloatArray) -> None:
    """Viscosity at radii (n,), mm, over that in wide vessels, into ``viscosity`` (n,)."""
    for k in range(len(radius)):
        viscosity[k] = relative_viscosity(radius[k], haematocrit)
