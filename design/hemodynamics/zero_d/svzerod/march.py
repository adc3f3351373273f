"""Time-step svZeroDSolver's lumped equations by the generalised-α method, as that program does.

Jansen, Whiting & Hulbert 2000, doi 10.1016/S0045-7825(00)00203-6, with ρ the spectral radius at
infinite steps: α_m = (3 - ρ)/(2 (1 + ρ)), α_f = 1/(1 + ρ), γ = ½ + α_m - α_f. Every variable is
stepped so, those without a rate in the equations, too: at t + α_f Δt the equations hold exactly.

Where equations are nonlinear, Newton's method ends at the first residual below the tolerance, as in
svZeroDSolver: what a file's units let slip below it is left as it is there, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.linalg.lapack import dgesv
from scipy.sparse import csc_array, csr_array

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod.factors import LARGE, Factors, by_rank, step_linear
from design.hemodynamics.zero_d.svzerod.nonlinear import Added, Moment
from design.hemodynamics.zero_d.svzerod.stamps import LumpedSystem
from design.hemodynamics.zero_d.svzerod.tables import Sampler
from design.network import FloatArray, IntArray

_STALE = 0.1
"""Factors are made anew once an iteration leaves more than this part of the residual."""
_EXACT = 1e-13
"""Residual, relative to the largest summand of its equation, that is rounding."""
_FULL: Final = 200
"""Unknowns up to which full matrices are faster."""
_MANY: Final = 2000
"""Unknowns from which factors are kept from one iteration to the next."""


@dataclass(frozen=True)
class State:
    """Values and rates of all variables, (n,) each."""

    value: FloatArray
    rate: FloatArray


@dataclass(frozen=True)
class _Passes:
    """What `step_linear` goes over, rows at their ``place`` in L."""

    place: IntArray
    constant: FloatArray
    entries: tuple[Any, ...]
    triangles: tuple[Any, ...]


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
        count = len(system.constant)
        self._keeps = count >= _MANY and all(term.smooth for term in self._terms)
        self._e, self._f = system.e, system.f
        self._base: Any = csc_array(self._weighted(system.e, system.f))
        self._full = bool(self._terms) and count <= _FULL
        if self._full:
            self._e, self._f = system.e.toarray(), system.f.toarray()
            self._base = np.asfortranarray(self._base.toarray())
        self._sizes = (abs(system.e), abs(system.f)) if self._keeps and self._terms else None
        self._predicted = system.e * (1.0 - self.alpha_m / self.gamma)
        self._factors: Factors | None = None
        self._large = not self._terms and count >= LARGE
        if self._large:
            # Memory of this size comes from the system, page by page, each time it is asked for.
            self._next, self._spare = (State(*np.empty((2, count))) for _ in range(2))
            self._work = np.empty(count)
            self._driven = np.flatnonzero(np.diff(system.drive.indptr))
            self._drive = system.drive[self._driven]
            self._passes: _Passes | None = None

    def _weighted(self, by_rate: Any, by_state: Any) -> Any:
        """Return the derivative by the rates' change, of derivatives by rates and values."""
        return self.alpha_m * by_rate + (self.alpha_f * self.gamma * self.step_s) * by_state

    def advance(self, old: State, time: float) -> State:
        """Return the state a step after ``time``; a later step may write into it.

        Raises
        ------
        FlowError
            For a singular system, or when Newton's method doesn't settle.
        """
        at = time + self.alpha_f * self.step_s
        sampled = self.sampler.at(at) if isinstance(self.sampler, Sampler) else self.sampler
        if self._large:
            return self._in_one_pass(old, sampled)
        constant = self.system.constant + self.system.drive @ sampled
        if self._terms:
            newton = self._with_kept_factors if self._keeps else self._newton
            return newton(old, at, sampled, constant)
        if self._factors is None:
            self._factors = Factors(self._base)
        change = self._predicted @ old.rate
        change += self.system.f @ old.value
        change += constant
        if float(np.abs(change).max()) < self.tolerance:
            return self._changed(old, np.zeros_like(change))
        return self._changed(old, -self._factors.solve(change))

    def _in_one_pass(self, old: State, sampled: FloatArray) -> State:
        """A step of a large linear system."""
        if self._passes is None:
            self._passes = self._prepared()
        new, passes, driven = self._next, self._passes, self._driven
        passes.constant[passes.place[driven]] = self.system.constant[driven] + self._drive @ sampled
        arguments: tuple[Any, ...] = (
            old.value, old.rate, passes.constant, *passes.entries, self.tolerance,
            1.0 - 1.0 / self.gamma, self.gamma * self.step_s, *passes.triangles,
            new.value, new.rate, self._work,
        )  # fmt: skip
        step_linear(*arguments)
        self._next, self._spare = self._spare, new
        return new

    def _prepared(self) -> _Passes:
        triangles = Factors(self._base).triangles()
        place = triangles[-2]
        constant = np.empty_like(self.system.constant)
        constant[place] = self.system.constant
        entries = (*by_rank(self._predicted, place), *by_rank(self.system.f, place))
        return _Passes(place, constant, entries, triangles)

    def _changed(self, old: State, change: FloatArray) -> State:
        """Return the state for a change of the predicted rates."""
        rate = old.rate * (1.0 - 1.0 / self.gamma)
        rate += change
        return State(old.value + change * (self.gamma * self.step_s), rate)

    def _moment(self, old: State, new: State, at: float, sampled: FloatArray) -> Moment:
        value = old.value + self.alpha_f * (new.value - old.value)
        rate = old.rate + self.alpha_m * (new.rate - old.rate)
        return Moment(at, self.period, value, rate, sampled)

    def _newton(self, old: State, at: float, sampled: FloatArray, constant: FloatArray) -> State:
        """Iterate as svZeroDSolver does, closed valves included."""
        new = State(old.value.copy(), old.rate * (1.0 - 1.0 / self.gamma))
        left = np.inf
        for _ in range(self.iterations):
            residual, added = self._residual(self._moment(old, new, at, sampled), constant)
            left = float(np.abs(residual).max())
            if left < self.tolerance:
                return new
            change = self._solved(added, residual)
            for term in added:
                new.value[term.shut] = 0.0
            new.rate[:] += change
            new.value[:] += change * (self.gamma * self.step_s)
        raise self._unsettled(at, left)

    def _solved(self, added: list[Added], residual: FloatArray) -> FloatArray:
        if not self._full:
            return Factors(self._matrix(added)).solve(residual)
        matrix = self._base.copy(order="F")
        for term in added:
            np.add.at(matrix, term.entries, self._weighted(term.by_rate, term.by_state))
        _, _, change, failed = dgesv(matrix, residual, overwrite_a=True)
        if failed:
            raise FlowError(Factors.SINGULAR)
        return np.asarray(change)

    def _with_kept_factors(
        self, old: State, at: float, sampled: FloatArray, constant: FloatArray
    ) -> State:
        change, last = np.zeros_like(old.value), np.inf
        for _ in range(self.iterations):
            new = self._changed(old, change)
            here = self._moment(old, new, at, sampled)
            residual, added = self._residual(here, constant)
            left = float(np.abs(residual).max())
            if self._settled(residual, left, last, here, constant):
                return new
            if self._factors is None or left > _STALE * last:
                self._factors = Factors(self._matrix(added))
            change += self._factors.solve(residual)
            last = left
        raise self._unsettled(at, last)

    def _unsettled(self, at: float, left: float) -> FlowError:
        return FlowError(
            f"no solution within {self.iterations} iterations at time {at:g}: {left:.3g} is left; "
            "take smaller steps (number_of_time_pts_per_cardiac_cycle)"
        )

    def _residual(self, here: Moment, constant: FloatArray) -> tuple[FloatArray, list[Added]]:
        residual = -(self._e @ here.rates + self._f @ here.state + constant)
        added = [term.at(here) for term in self._terms]
        for term in added:
            np.subtract.at(residual, term.rows, term.value)
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
        rows, columns = (np.concatenate([a.entries[k] for a in added]) for k in (0, 1))
        value = np.concatenate([self._weighted(a.by_rate, a.by_state) for a in added])
        return csc_array(self._base + csr_array((value, (rows, columns)), self._base.shape))
