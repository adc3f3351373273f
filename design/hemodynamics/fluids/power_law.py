"""Apparent viscosity of a power-law fluid, τ = K γ̇ⁿ, in tube flow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.errors import FlowError
from design.hemodynamics.fluids.fluid import SLOWEST, check_positive
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class PowerLaw:
    """μ_app = K ((3n + 1)/(4n))ⁿ Γⁿ⁻¹ (Bird, Stewart & Lightfoot, Transport Phenomena, 8.3).

    Attributes
    ----------
    consistency_pa_sn : float, Pa·sⁿ
    index : float
        n: below 1 the fluid gets thinner as it is sheared. 0.1 to 2.
    """

    consistency_pa_sn: float
    index: float

    def __post_init__(self) -> None:
        check_positive("the power law's consistency", self.consistency_pa_sn, "Pa·sⁿ")
        if not 0.1 <= self.index <= 2.0:
            raise FlowError(f"the power law's index is {self.index:g}; give 0.1 to 2")

    @property
    def linear(self) -> bool:
        """Whether n is 1."""
        return self.index == 1.0

    def apparent(self, rate: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
        """In closed form; Newtonian below `SLOWEST`."""
        n = self.index
        factor = self.consistency_pa_sn * ((3.0 * n + 1.0) / (4.0 * n)) ** n
        viscosity = factor * np.maximum(rate, SLOWEST) ** (n - 1.0)
        return viscosity, np.where(rate > SLOWEST, n, 1.0)
