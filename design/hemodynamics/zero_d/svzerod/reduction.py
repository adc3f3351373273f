"""Reduce a small nonlinear lumped system to the equations that hold nonlinear terms."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import qr, solve_triangular
from scipy.sparse import csr_array

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod.factors import Factors
from design.hemodynamics.zero_d.svzerod.generalised_alpha import Pace
from design.hemodynamics.zero_d.svzerod.terms import Terms
from kernels.arrays import FloatArray, IntArray

_RANK: Final = 1e-14
"""Share of the largest pivot from which on equations are singular."""
_SLIGHT: Final = 1e-9
"""Weight of leaving rows and columns as they are, so that what scales them is one."""


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
    entries = matrix.tocoo()
    return entries.row.astype(np.int64), entries.col.astype(np.int64), entries.data


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
