"""Apparent viscosity of a Carreau-Yasuda fluid in tube flow, by the Rabinowitsch relation.

μ(γ̇) = μ_∞ + (μ_0 - μ_∞) (1 + (λγ̇)^a)^((n-1)/a) (Yasuda, Armstrong & Cohen 1981, doi
10.1007/BF01513059; Carreau's own has a = 2). In a tube the stress goes linearly from 0 to τ_w, and

    Γ = 4/τ_w³ ∫₀^τ_w τ² γ̇ dτ

(Rabinowitsch 1929), which is integrated once for each fluid; a vessel then needs a look-up.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np

from design.errors import FlowError
from design.hemodynamics.fluids.fluid import SLOWEST, check_positive
from kernels.arrays import FloatArray

if TYPE_CHECKING:
    from scipy.interpolate import CubicHermiteSpline

_DECADES: Final = (-5.0, 9.0)
_KNOTS: Final = 1401
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
        check_positive("the viscosity at rest", self.zero_shear_pa_s, "Pa·s")
        check_positive("the viscosity at infinite shear", self.infinite_shear_pa_s, "Pa·s")
        check_positive("the Carreau time", self.time_s, "s")
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

        log_rate = np.linspace(*_DECADES, _KNOTS) * np.log(10.0)
        rate = np.exp(log_rate)
        stress = rate * self.viscosity(rate)
        moment = np.concatenate([[0.0], np.cumsum(self._pieces(log_rate))])
        # Below the first knot the fluid is at rest's viscosity.
        moment += stress[0] ** 3 * rate[0] / 4.0
        gamma = 4.0 * moment / stress**3
        return CubicHermiteSpline(np.log(gamma), np.log(stress), 1.0 / (4.0 * rate / gamma - 3.0))

    def _pieces(self, log_rate: FloatArray) -> FloatArray:
        """∫ γ̇ τ² dτ between knots, by Gauss's rule in ln γ̇."""
        half = np.diff(log_rate)[:, None] / 2.0
        x = (log_rate[:-1, None] + half) + half * _GAUSS[0]
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
