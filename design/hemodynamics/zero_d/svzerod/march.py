"""Step a lumped system by the generalised-α method, as svZeroDSolver does.

Jansen, Whiting & Hulbert 2000, doi 10.1016/S0045-7825(00)00203-6, with ρ the spectral radius at
infinite steps: α_m = (3 - ρ)/(2 (1 + ρ)), α_f = 1/(1 + ρ), γ = ½ + α_m - α_f. Every variable is
stepped so, those without a rate in the equations, too: at t + α_f Δt the equations hold exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csc_array, csr_array

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod.factors import Factors
from design.hemodynamics.zero_d.svzerod.nonlinear import Added, Moment
from design.hemodynamics.zero_d.svzerod.stamps import LumpedSystem
from design.hemodynamics.zero_d.svzerod.tables import Sampler
from design.network import FloatArray

_STALE = 0.1
"""Factors are made anew once an iteration leaves more than this part of the residual."""
_EXACT = 1e-13
"""Residual, relative to the largest summand of its equation, that is rounding."""


@dataclass(frozen=True)
class State:
    """Values and rates of all variables, (n,) each."""

    value: FloatArray
    rate: FloatArray


class Stepper:
    """System with a fixed step.

    Parameters
    ----------
    sampler : Sampler or FloatArray
        Tables, or their values where they don't change, (tables,).
    """

    def __init__(
        self, system: LumpedSystem, sampler: Sampler | FloatArray, period: float, step: float,
        rho: float, tolerance: float, iterations: int,
    ) -> None:  # fmt: skip
        self.system, self.sampler, self.period, self.step_s = system, sampler, period, step
        self.tolerance, self.iterations = tolerance, iterations
        self.alpha_m, self.alpha_f = 0.5 * (3.0 - rho) / (1.0 + rho), 1.0 / (1.0 + rho)
        self.gamma = 0.5 + self.alpha_m - self.alpha_f
        self._terms = system.terms
        self._base = csc_array(self._weighted(system.e, system.f))
        self._sizes = (abs(system.e), abs(system.f)) if self._terms else None
        self._predicted = system.e * (1.0 - self.alpha_m / self.gamma)
        self._factors: Factors | None = None

    def _weighted(self, by_rate: Any, by_state: Any) -> Any:
        """Return the derivative by the rates' change, of derivatives by rates and values."""
        return self.alpha_m * by_rate + (self.alpha_f * self.gamma * self.step_s) * by_state

    def advance(self, old: State, time: float) -> State:
        """Return the state a step after ``time``.

        Raises
        ------
        FlowError
            For a singular system, or when Newton's method doesn't settle.
        """
        at = time + self.alpha_f * self.step_s
        sampled = self.sampler.at(at) if isinstance(self.sampler, Sampler) else self.sampler
        constant = self.system.constant + self.system.drive @ sampled
        if self._terms:
            return self._newton(old, at, sampled, constant)
        if self._factors is None:
            self._factors = Factors(self._base)
        change = self._predicted @ old.rate
        change += self.system.f @ old.value
        change += constant
        return self._changed(old, -self._factors.solve(change))

    def _changed(self, old: State, change: FloatArray) -> State:
        """Return the state for a change of the predicted rates."""
        rate = old.rate * (1.0 - 1.0 / self.gamma)
        rate += change
        return State(old.value + change * (self.gamma * self.step_s), rate)

    def _newton(self, old: State, at: float, sampled: FloatArray, constant: FloatArray) -> State:
        change, last = np.zeros_like(old.value), np.inf
        for _ in range(self.iterations):
            new = self._changed(old, change)
            here = Moment(
                at, self.period,
                old.value + self.alpha_f * (new.value - old.value),
                old.rate + self.alpha_m * (new.rate - old.rate),
                sampled,
            )  # fmt: skip
            residual, added = self._residual(here, constant)
            left = float(np.abs(residual).max())
            if self._settled(residual, left, last, here, constant):
                return new
            if self._factors is None or left > _STALE * last:
                self._factors = Factors(self._matrix(added))
            change += self._factors.solve(residual)
            last = left
        raise FlowError(
            f"no solution within {self.iterations} iterations at time {at:g}: {last:.3g} is left; "
            "take smaller steps (number_of_time_pts_per_cardiac_cycle)"
        )

    def _residual(self, here: Moment, constant: FloatArray) -> tuple[FloatArray, list[Added]]:
        residual = -(self.system.e @ here.rates + self.system.f @ here.state + constant)
        added = [term.at(here) for term in self._terms]
        for term, more in zip(self._terms, added, strict=True):
            np.subtract.at(residual, term.rows, more.value)
        return residual, added

    def _settled(
        self, residual: FloatArray, left: float, last: float, here: Moment, constant: FloatArray
    ) -> bool:
        """Whether what is left is rounding, or within the tolerance and no longer falls."""
        if left <= self.tolerance and left > 0.5 * last:
            return True
        assert self._sizes is not None
        e, f = self._sizes
        size = e @ np.abs(here.rates) + f @ np.abs(here.state) + np.abs(constant)
        return bool((np.abs(residual) <= _EXACT * size).all())

    def _matrix(self, added: list[Added]) -> csc_array:
        rows = np.concatenate([term.rows for term in self._terms])
        columns = np.concatenate([term.columns for term in self._terms])
        value = np.concatenate([self._weighted(a.by_rate, a.by_state) for a in added])
        return csc_array(self._base + csr_array((value, (rows, columns)), self._base.shape))
