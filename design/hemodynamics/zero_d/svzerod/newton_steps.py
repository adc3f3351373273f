"""Reduce a small nonlinear system to the equations that hold nonlinear terms; step it so."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import qr, solve_triangular
from scipy.sparse import csr_array

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod.factors import Factors
from design.hemodynamics.zero_d.svzerod.pace import Pace
from design.hemodynamics.zero_d.svzerod.term_values import term_values
from design.hemodynamics.zero_d.svzerod.terms import Terms
from design.network import FloatArray, IntArray
from kernels import jit

_RANK: Final = 1e-14
"""Share of the largest pivot from which on equations are singular."""
_SLIGHT: Final = 1e-9
"""Weight of leaving rows and columns as they are, so that what scales them is one."""

DONE: Final = 0
UNSETTLED: Final = 1
SINGULAR: Final = 2


class Reduced(NamedTuple):
    """Equations E ẏ + F y + c + terms = 0 of n variables, r of them with terms whose slopes count.

    The others hold for every correction x alike: x = gain b + spread z, with b what they lack and
    z the r free variables, whose equations are (base + …) z = rest - carry b.

    Attributes
    ----------
    e_row, e_column, e, f_row, f_column, f
        Numbers of E and F and where they stand.
    linear, rest : (n - r,), (r,) int64
        Equations without and with slopes.
    place : (n,) int64
        Of an equation in ``rest``; -1 for the others.
    weight : (r,) float64
        Of the equations in ``rest``, in ``base`` and ``carry``.
    gain : (n - r, n) float64
    spread, across : (n, r), (r, n) float64
        The same, transposed.
    base : (r, r) float64
    carry : (n - r, r) float64
    alpha_m, alpha_f, gamma, step, tolerance : float
    iterations : int
    """

    e_row: IntArray
    e_column: IntArray
    e: FloatArray
    f_row: IntArray
    f_column: IntArray
    f: FloatArray
    linear: IntArray
    rest: IntArray
    place: IntArray
    weight: FloatArray
    gain: FloatArray
    spread: FloatArray
    across: FloatArray
    base: FloatArray
    carry: FloatArray
    alpha_m: float
    alpha_f: float
    gamma: float
    step: float
    tolerance: float
    iterations: int


def reduced_system(e: csr_array, f: csr_array, terms: Terms, pace: Pace) -> Reduced:
    """Return the reduced equations.

    Parameters
    ----------
    e, f : csr_array, (n, n)
        Without terms.

    Raises
    ------
    FlowError
        When equations without terms contradict or repeat each other.
    """
    matrix = csr_array(pace.weighted(e, f)).toarray()
    with_slopes = np.zeros(len(matrix), dtype=bool)
    with_slopes[terms.slope_row] = True
    linear, rest = np.flatnonzero(~with_slopes), np.flatnonzero(with_slopes)
    place = np.full(len(matrix), -1)
    place[rest] = np.arange(len(rest))
    gain, spread = _eliminated(matrix[linear])
    base = matrix[rest] @ spread
    weight = 1.0 / _or_one(np.abs(base).max(axis=1, initial=0.0))
    others = weight[:, None] * matrix[rest]
    return Reduced(
        *_entries(e), *_entries(f), linear, rest, place, weight, np.ascontiguousarray(gain.T),
        spread, np.ascontiguousarray(spread.T), others @ spread,
        np.ascontiguousarray((others @ gain).T), pace.alpha_m, pace.alpha_f, pace.gamma,
        pace.step, pace.tolerance, pace.iterations,
    )  # fmt: skip


def _entries(matrix: csr_array) -> tuple[IntArray, IntArray, FloatArray]:
    found = matrix.tocoo()
    return found.row.astype(np.int64), found.col.astype(np.int64), found.data


def _eliminated(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solve m equations of n variables for m of these: x = gain b + spread z; (n, m), (n, n - m).

    Which is chosen by pivoting of rows and columns whose sizes were made alike.
    """
    count, size = matrix.shape
    gain, spread = np.zeros((size, count)), np.zeros((size, size - count))
    if not count:
        return gain, np.eye(size)
    rows, columns = _balance(matrix)
    q, triangle, order = qr(rows[:, None] * matrix * columns, mode="economic", pivoting=True)
    pivots = np.abs(np.diagonal(triangle))
    if not pivots[-1] > _RANK * pivots[0]:
        raise FlowError(Factors.SINGULAR)
    solved, free = order[:count], order[count:]
    scale = columns[solved, None]
    gain[solved] = scale * solve_triangular(triangle[:, :count], q.T) * rows
    spread[solved] = -scale * solve_triangular(triangle[:, :count], triangle[:, count:])
    spread[free] = np.diag(columns[free])  # free variables in units of their own
    return gain, spread


def _or_one(sizes: FloatArray) -> FloatArray:
    return np.where(sizes > 0.0, sizes, 1.0)


def _balance(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Factors of rows and columns that bring all numbers near 1, whatever their units.

    Least squares of the logarithms (Curtis & Reid 1972, doi 10.1093/imamat/10.1.118).
    """
    row, column = np.nonzero(matrix)
    count, size = matrix.shape
    sides = np.zeros((len(row), count + size))
    sides[np.arange(len(row)), row] = sides[np.arange(len(row)), count + column] = 1.0
    normal = sides.T @ sides + _SLIGHT * np.eye(count + size)
    logs = -np.linalg.solve(normal, sides.T @ np.log(np.abs(matrix[row, column])))
    return np.exp(logs[:count]), np.exp(logs[count:])


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
