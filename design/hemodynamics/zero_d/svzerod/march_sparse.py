"""Step large nonlinear lumped equations of svZeroDSolver by Newton's method with sparse factors."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from scipy.sparse import csc_array, csr_array

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod.factors import Factors
from design.hemodynamics.zero_d.svzerod.generalised_alpha import Pace, State
from design.hemodynamics.zero_d.svzerod.stamps import LumpedSystem
from design.hemodynamics.zero_d.svzerod.term_values import term_values
from design.hemodynamics.zero_d.svzerod.terms import (
    SMOOTH,
    Moments,
    joined_terms,
    timed_coefficients,
)
from kernels.arrays import FloatArray, IntArray

_STALE: Final = 0.1
"""Factors are made anew once an iteration leaves more than this part of the residual."""
_EXACT: Final = 1e-13
"""Residual, relative to the largest summand of its equation, that is rounding."""
_MANY: Final = 2000
"""Unknowns from which factors are kept from one iteration to the next."""


class SparseMarch:
    """Nonlinear system with a fixed step."""

    def __init__(self, system: LumpedSystem, pace: Pace) -> None:
        self._system, self._pace = system, pace
        self._terms = joined_terms(system.terms)
        self._base = csc_array(pace.weighted(system.e, system.f))
        self._sizes = (abs(system.e), abs(system.f))
        smooth = all(group.kind in SMOOTH for group in system.terms)
        self._keeps = smooth and len(system.constant) >= _MANY
        self._factors: Factors | None = None
        slopes = len(self._terms.slope_row)
        self._by_state, self._by_rate = np.zeros((2, slopes))
        self._added = np.empty(len(self._terms.value_row))
        self._shut: IntArray = np.empty(len(self._terms.kind), dtype=np.int64)

    def march(self, state: State, moments: Moments) -> Iterator[State]:
        """Yield the state behind each step.

        Raises
        ------
        FlowError
            For a singular system, or when Newton's method doesn't settle.
        """
        step = self._with_kept_factors if self._keeps else self._newton
        timed = timed_coefficients(self._system.terms, moments)
        for k, time in enumerate(moments.times.tolist()):
            constant = self._system.constant + self._system.drive @ moments.sampled[k]
            state = step(state, time, constant, timed[k])
            yield state

    def _middle(self, old: State, new: State) -> State:
        """Where the equations hold."""
        value = old.value + self._pace.alpha_f * (new.value - old.value)
        return State(value, old.rate + self._pace.alpha_m * (new.rate - old.rate))

    def _residual(self, here: State, constant: FloatArray, timed: FloatArray) -> FloatArray:
        """What the equations lack; slopes and closed valves are kept for what follows."""
        terms = self._terms
        term_values(
            terms, timed, here.value, here.rate, self._added, self._by_state, self._by_rate,
            self._shut,
        )  # fmt: skip
        left = -(self._system.e @ here.rate + self._system.f @ here.value + constant)
        np.subtract.at(left, terms.value_row, self._added)
        return np.asarray(left)

    def _matrix(self) -> csc_array:
        value = self._pace.weighted(self._by_rate, self._by_state)
        place = (self._terms.slope_row, self._terms.slope_column)
        return csc_array(self._base + csr_array((value, place), self._base.shape))

    def _newton(self, old: State, at: float, constant: FloatArray, timed: FloatArray) -> State:
        """Iterate as svZeroDSolver does, closed valves included."""
        pace, left = self._pace, np.inf
        new = State(old.value.copy(), old.rate * (1.0 - 1.0 / pace.gamma))
        for _ in range(pace.iterations):
            residual = self._residual(self._middle(old, new), constant, timed)
            left = float(np.abs(residual).max())
            if left < pace.tolerance:
                return new
            change = Factors(self._matrix()).solve(residual)
            new.value[self._shut[self._shut >= 0]] = 0.0
            new.rate[:] += change
            new.value[:] += change * (pace.gamma * pace.step)
        raise unsettled(pace, at, left)

    def _with_kept_factors(
        self, old: State, at: float, constant: FloatArray, timed: FloatArray
    ) -> State:
        change, last = np.zeros_like(old.value), np.inf
        for _ in range(self._pace.iterations):
            new = self._pace.changed(old, change)
            here = self._middle(old, new)
            residual = self._residual(here, constant, timed)
            left = float(np.abs(residual).max())
            if self._settled(residual, left, last, here, constant):
                return new
            if self._factors is None or left > _STALE * last:
                self._factors = Factors(self._matrix())
            change += self._factors.solve(residual)
            last = left
        raise unsettled(self._pace, at, last)

    def _settled(
        self, residual: FloatArray, left: float, last: float, here: State, constant: FloatArray
    ) -> bool:
        """Whether what is left is rounding, or within the tolerance and no longer falls."""
        if left <= self._pace.tolerance and left > 0.5 * last:
            return True
        e, f = self._sizes
        size = e @ np.abs(here.rate) + f @ np.abs(here.value) + np.abs(constant)
        return bool((np.abs(residual) <= _EXACT * size).all())


def unsettled(pace: Pace, at: float, left: float) -> FlowError:
    """Return the error of a step that Newton's method doesn't solve."""
    return FlowError(
        f"no solution within {pace.iterations} iterations at time {at:g}: {left:.3g} is left; "
        "take smaller steps (number_of_time_pts_per_cardiac_cycle)"
    )
