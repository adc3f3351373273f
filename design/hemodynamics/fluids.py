"""Fluid viscosity models: Newtonian, shear-rate dependent, or blood by vessel diameter.

Goes in: a fluid's constants, a radius, a shear rate. Comes out: apparent viscosity, Pa·s.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from design.errors import FlowError
from design.units import BLOOD_MPA_S
from kernels.arrays import FloatArray

if TYPE_CHECKING:
    from scipy.interpolate import CubicHermiteSpline


# With Γ = 4Q/(πr³), the wall shear rate of a Newtonian fluid of the same flow, steady laminar flow
# of any fluid whose viscosity follows the shear rate has a wall stress that depends on Γ alone
# (Rabinowitsch 1929): τ_w = μ_app(Γ) Γ. So one function of one number stands for the whole section,
# and Poiseuille's law holds with μ_app in it.
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
        require_above_zero("viscosity", self.viscosity_pa_s, "Pa·s")

    @property
    def linear(self) -> bool:
        """True."""
        return True

    def apparent(self, rate: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Its viscosity, and 1."""
        return np.full(np.shape(rate), self.viscosity_pa_s), np.ones(np.shape(rate))


def require_above_zero(name: str, value: float, unit: str) -> None:
    """Raise `FlowError` unless a number is finite and above 0."""
    if not (np.isfinite(value) and value > 0.0):
        raise FlowError(f"{name} is {value:g} {unit}; give a number above 0".replace(" ;", ";"))


# μ(γ̇) = μ_∞ + (μ_0 - μ_∞) (1 + (λγ̇)^a)^((n-1)/a) (Yasuda, Armstrong & Cohen 1981, doi
# 10.1007/BF01513059; Carreau's own has a = 2). In a tube the stress goes linearly from 0 to τ_w,
# and
#
# Γ = 4/τ_w³ ∫₀^τ_w τ² γ̇ dτ
#
# (Rabinowitsch 1929), which is integrated once for each fluid; a vessel then needs a look-up.
_LOG_RATES: Final = np.linspace(-5.0, 9.0, 1401) * np.log(10.0)
"""Knots of the table: 100 a decade of shear rates in 1/s."""
_GAUSS: Final = np.polynomial.legendre.leggauss(8)


@dataclass(frozen=True)
class Carreau:
    """Carreau-Yasuda, exact over the tube's section to 1e-8.

    The defaults are blood at 37 °C, of Cho & Kensey 1991 (doi 10.3233/BIR-1991-283-415).

    Attributes
    ----------
    zero_shear_pa_s, infinite_shear_pa_s : float, Pa·s
    time_s : float, s
        λ.
    index : float
        n, 0.1 to 1.
    yasuda : float
        a, 0.2 to 10.
    """

    zero_shear_pa_s: float = 0.056
    infinite_shear_pa_s: float = 0.00345
    time_s: float = 3.313
    index: float = 0.3568
    yasuda: float = 2.0

    def __post_init__(self) -> None:
        require_above_zero("the viscosity at rest", self.zero_shear_pa_s, "Pa·s")
        require_above_zero("the viscosity at infinite shear", self.infinite_shear_pa_s, "Pa·s")
        require_above_zero("the Carreau time", self.time_s, "s")
        if self.infinite_shear_pa_s > self.zero_shear_pa_s:
            raise FlowError(
                f"the viscosity at infinite shear, {self.infinite_shear_pa_s:g} Pa·s, is above "
                f"that at rest, {self.zero_shear_pa_s:g}; swap them"
            )
        if not (0.1 <= self.index <= 1.0 and 0.2 <= self.yasuda <= 10.0):
            raise FlowError(
                f"Carreau's index is {self.index:g} and Yasuda's exponent {self.yasuda:g}; give "
                "0.1 to 1 and 0.2 to 10"
            )

    @property
    def linear(self) -> bool:
        """Whether it doesn't get thinner at all."""
        return self.index == 1.0 or self.zero_shear_pa_s == self.infinite_shear_pa_s

    def viscosity(self, rate: FloatArray) -> FloatArray:
        """Of the fluid itself at a shear rate, Pa·s, same shape."""
        grown = 1.0 + (self.time_s * np.asarray(rate)) ** self.yasuda
        thinned = grown ** ((self.index - 1.0) / self.yasuda)
        span = self.zero_shear_pa_s - self.infinite_shear_pa_s
        return np.asarray(self.infinite_shear_pa_s + span * thinned)

    def apparent(self, rate: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
        """By the table; Newtonian below `SLOWEST`."""
        at = np.log(np.maximum(rate, SLOWEST))
        spline = self._table
        low, high = spline.x[0], spline.x[-1]
        if at.size and at.max() > high:
            raise FlowError(
                f"a shear rate of {np.exp(at.max()):.3g}/s leaves the range of the Carreau fluid, "
                f"{np.exp(high):.1g}/s; check the network's unit and the flow"
            )
        at = np.maximum(at, low)
        stress, index = np.exp(spline(at)), spline(at, 1)
        return stress / np.exp(at), np.where(rate > SLOWEST, index, 1.0)

    @cached_property
    def _table(self) -> CubicHermiteSpline:
        """Ln τ_w over ln Γ.

        With M = ∫₀^γ̇_w γ̇ τ² (dτ/dγ̇) dγ̇, the flow's moment, Γ = 4 M/τ_w³; and the slope is
        d ln Γ/d ln τ_w = 4 γ̇_w/Γ - 3 (Rabinowitsch).
        """
        from scipy.interpolate import CubicHermiteSpline  # heavy: other fluids do without

        rate = np.exp(_LOG_RATES)
        stress = rate * self.viscosity(rate)
        moment = np.concatenate([[0.0], np.cumsum(self._pieces())])
        # Below the first knot the fluid is at rest's viscosity.
        moment += stress[0] ** 3 * rate[0] / 4.0
        gamma = 4.0 * moment / stress**3
        return CubicHermiteSpline(np.log(gamma), np.log(stress), 1.0 / (4.0 * rate / gamma - 3.0))

    def _pieces(self) -> FloatArray:
        """∫ γ̇ τ² dτ between knots, by Gauss's rule in ln γ̇."""
        half = np.diff(_LOG_RATES)[:, None] / 2.0
        x = (_LOG_RATES[:-1, None] + half) + half * _GAUSS[0]
        rate = np.exp(x)
        stress = rate * self.viscosity(rate)
        value = rate * stress**3 * self._slope(rate)
        return np.asarray((value * _GAUSS[1] * half).sum(axis=1))

    def _slope(self, rate: FloatArray) -> FloatArray:
        """D ln τ/d ln γ̇ of the fluid itself."""
        x = (self.time_s * rate) ** self.yasuda
        thinning = self.viscosity(rate) - self.infinite_shear_pa_s
        part = thinning / self.viscosity(rate)
        return np.asarray(1.0 + part * (self.index - 1.0) * x / (1.0 + x))


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
        require_above_zero("the power law's consistency", self.consistency_pa_sn, "Pa·sⁿ")
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
        require_above_zero("viscosity", self.viscosity_pa_s, "Pa·s")
        if not 0.0 <= self.haematocrit <= 0.8:
            raise FlowError(f"the haematocrit is {self.haematocrit:g}; give 0 to 0.8")

    @property
    def linear(self) -> bool:
        """True: it doesn't depend on the flow."""
        return True

    def apparent(self, rate: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
        """By the radius, and 1."""
        # Here, since the growth of trees comes with it.
        from design.vasculature.viscosity import relative_viscosities

        wide = np.broadcast_to(np.asarray(radius, dtype=np.float64), np.shape(rate))
        viscosity = np.empty(wide.shape)
        relative_viscosities(wide.ravel(), self.haematocrit, viscosity.reshape(-1))
        return self.viscosity_pa_s * viscosity, np.ones(wide.shape)
