"""Kernel: time-step a reduced nonlinear lumped system, each step solved by Newton's method."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.hemodynamics.zero_d.svzerod.reduction import Reduced
from design.hemodynamics.zero_d.svzerod.term_values import term_values
from design.hemodynamics.zero_d.svzerod.terms import Terms
from kernels import jit
from kernels.arrays import FloatArray

DONE: Final = 0
UNSETTLED: Final = 1
SINGULAR: Final = 2


@jit
def march_reduced(
    system: Reduced, terms: Terms, constants: FloatArray, timed: FloatArray, value: FloatArray,
    rate: FloatArray, values: FloatArray, rates: FloatArray,
) -> tuple[int, int, float]:  # fmt: skip
    """Step a small nonlinear system, closed valves included, as svZeroDSolver does.

    Newton's method ends at the first residual below the tolerance.

    Parameters
    ----------
    constants : (s, n) float64
        c at each step's time.
    timed : (s, t, 3) float64
        `terms.timed_coefficients`.
    value, rate : (n,) float64
        At the begin.
    values, rates : (s, n) float64
        Written: behind each step.

    Returns
    -------
    tuple of (int, int, float)
        `DONE`, `UNSETTLED` or `SINGULAR`, at which step, and the residual that was left there.
    """
    count, kept = len(value), 1.0 - 1.0 / system.gamma
    residual, middle, middle_rate = np.empty(count), np.empty(count), np.empty(count)
    change = np.empty(count)
    matrix, free = np.empty_like(system.base), np.empty(len(system.rest))
    added = np.empty(len(terms.value_row))
    by_state, by_rate = np.zeros(len(terms.slope_row)), np.zeros(len(terms.slope_row))
    shut = np.empty(len(terms.kind), np.int64)
    for s in range(len(constants)):
        old, old_rate = value, rate
        value, rate = values[s], rates[s]
        for i in range(count):
            value[i], rate[i] = old[i], kept * old_rate[i]
        settled, left = False, 0.0
        for _ in range(system.iterations):
            for i in range(count):
                middle[i] = old[i] + system.alpha_f * (value[i] - old[i])
                middle_rate[i] = old_rate[i] + system.alpha_m * (rate[i] - old_rate[i])
            term_values(terms, timed[s], middle, middle_rate, added, by_state, by_rate, shut)
            left = _residual(system, terms, constants[s], middle, middle_rate, added, residual)
            if left < system.tolerance:
                settled = True
                break
            if not _correct(system, terms, residual, by_state, by_rate, matrix, free, change):
                return SINGULAR, s, left
            for k in range(len(shut)):
                if shut[k] >= 0:
                    value[shut[k]] = 0.0
            for i in range(count):
                rate[i] += change[i]
                value[i] += system.gamma * system.step * change[i]
        if not settled:
            return UNSETTLED, s, left
    return DONE, len(constants), 0.0


@jit
def _residual(
    system: Reduced, terms: Terms, constant: FloatArray, state: FloatArray, rate: FloatArray,
    added: FloatArray, residual: FloatArray,
) -> float:  # fmt: skip
    """Write what the equations lack; return its largest size, NaN where there is one."""
    for i in range(len(residual)):
        residual[i] = -constant[i]
    for k in range(len(system.e)):
        residual[system.e_row[k]] -= system.e[k] * rate[system.e_column[k]]
    for k in range(len(system.f)):
        residual[system.f_row[k]] -= system.f[k] * state[system.f_column[k]]
    for k in range(len(added)):
        residual[terms.value_row[k]] -= added[k]
    largest = 0.0
    for i in range(len(residual)):
        if not abs(residual[i]) <= largest:
            largest = abs(residual[i])
    return largest


@jit
def _correct(
    system: Reduced, terms: Terms, residual: FloatArray, by_state: FloatArray,
    by_rate: FloatArray, matrix: FloatArray, free: FloatArray, change: FloatArray,
) -> bool:  # fmt: skip
    """Write Newton's change of the rates; return whether there is a single one."""
    change[:] = 0.0
    matrix[:] = system.base
    for i in range(len(free)):
        free[i] = system.weight[i] * residual[system.rest[i]]
    for k in range(len(system.linear)):
        lacking = residual[system.linear[k]]
        if lacking != 0.0:
            for i in range(len(change)):
                change[i] += lacking * system.gain[k, i]
            for i in range(len(free)):
                free[i] -= lacking * system.carry[k, i]
    factor = system.alpha_f * system.gamma * system.step
    for k in range(len(by_state)):
        row, column = system.place[terms.slope_row[k]], terms.slope_column[k]
        slope = system.weight[row] * (system.alpha_m * by_rate[k] + factor * by_state[k])
        free[row] -= slope * change[column]
        for j in range(len(free)):
            matrix[row, j] += slope * system.spread[column, j]
    if not _solve(matrix, free):
        return False
    for j in range(len(free)):
        for i in range(len(change)):
            change[i] += free[j] * system.across[j, i]
    return True


@jit
def _solve(matrix: FloatArray, right: FloatArray) -> bool:
    """Solve a small full system in place, by elimination with the largest pivot of each column."""
    size = len(right)
    for k in range(size):
        best = k
        for i in range(k + 1, size):
            if abs(matrix[i, k]) > abs(matrix[best, k]):
                best = i
        if matrix[best, k] == 0.0:
            return False
        if best != k:
            right[k], right[best] = right[best], right[k]
            for j in range(k, size):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
        for i in range(k + 1, size):
            factor = matrix[i, k] / matrix[k, k]
            if factor != 0.0:
                right[i] -= factor * right[k]
                for j in range(k + 1, size):
                    matrix[i, j] -= factor * matrix[k, j]
    for k in range(size - 1, -1, -1):
        for j in range(k + 1, size):
            right[k] -= matrix[k, j] * right[j]
        right[k] /= matrix[k, k]
    return True
