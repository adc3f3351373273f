"""Interface of fluids (apparent viscosity in tube flow), and the Newtonian fluid.

With Γ = 4Q/(πr³), the wall shear rate of a Newtonian fluid of the same flow, steady laminar flow
of any fluid whose viscosity follows the shear rate has a wall stress that depends on Γ alone
(Rabinowitsch 1929): τ_w = μ_app(Γ) Γ. So one function of one number stands for the whole section,
and Poiseuille's law holds with μ_app in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from design.errors import FlowError
from kernels.arrays import FloatArray

SLOWEST: Final = 1e-3
"""Shear rate, 1/s, below which every fluid is taken as Newtonian: nothing measured lies below, and
a power law would have no viscosity at rest, or an infinite one."""


class Fluid(Protocol):
    """Anything that has an apparent viscosity."""

    @property
    def linear(self) -> bool:
        """Whether the pressure drop of a vessel is proportional to its flow."""
        ...

    def apparent(self, rate: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
        """μ_app, Pa·s, and d ln τ_w/d ln Γ.

        Parameters
        ----------
        rate : (...) float64, 1/s
            Γ, not negative.
        radius : (...) float64, mm
        """
        ...


@dataclass(frozen=True)
class Newtonian:
    """Newtonian fluid: viscosity independent of flow and radius.

    Attributes
    ----------
    viscosity_pa_s : float, Pa·s
    """

    viscosity_pa_s: float

    def __post_init__(self) -> None:
        check_positive("viscosity", self.viscosity_pa_s, "Pa·s")

    @property
    def linear(self) -> bool:
        """True."""
        return True

    def apparent(self, rate: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Its viscosity, and 1."""
        return np.full(np.shape(rate), self.viscosity_pa_s), np.ones(np.shape(rate))


def check_positive(name: str, value: float, unit: str) -> None:
    """Raise `FlowError` where a value isn't above 0."""
    if not (np.isfinite(value) and value > 0.0):
        raise FlowError(f"{name} is {value:g} {unit}; give a number above 0".replace("  ", " "))
