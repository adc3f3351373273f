"""Viscosity of blood by vessel radius and haematocrit: the in vivo law of Pries et al. 1994."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.errors import FlowError
from design.hemodynamics.fluids.fluid import check_positive
from design.units import BLOOD_MPA_S
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class Pries1994:
    """Viscosity by diameter (doi 10.1161/01.RES.75.5.904), the same law that trees grow by.

    Not modelled: how red cells divide at bifurcations. The haematocrit is the same everywhere.

    Attributes
    ----------
    viscosity_pa_s : float, Pa·s
        In wide vessels: 4 mPa·s at a haematocrit of 0.45 means a plasma of 1.25 mPa·s.
    haematocrit : float
        Discharge haematocrit, 0 to 0.8.
    """

    viscosity_pa_s: float = BLOOD_MPA_S * 1e-3
    haematocrit: float = 0.45

    def __post_init__(self) -> None:
        check_positive("viscosity", self.viscosity_pa_s, "Pa·s")
        if not 0.0 <= self.haematocrit <= 0.8:
            raise FlowError(f"the haematocrit is {self.haematocrit:g}; give 0 to 0.8")

    @property
    def linear(self) -> bool:
        """True: it doesn't depend on the flow."""
        return True

    def apparent(self, rate: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
        """By the radius, and 1."""
        # Here, since the growth of trees comes with it.
        from design.vasculature.viscosity import relative

        wide = np.broadcast_to(np.asarray(radius, dtype=np.float64), np.shape(rate))
        viscosity = np.empty(wide.shape)
        relative(wide.ravel(), self.haematocrit, viscosity.reshape(-1))
        return self.viscosity_pa_s * viscosity, np.ones(wide.shape)
