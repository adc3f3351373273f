"""Factorise a sparse matrix once and solve with it many times."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from scipy.sparse import csc_array, csr_array, tril, triu
from scipy.sparse.linalg import splu

from design.errors import FlowError
from kernels import jit
from kernels.arrays import FloatArray

LARGE: Final = 2000
"""Unknowns from which the kernel's solution is faster than SuperLU's, whose blocks stay tiny."""


class Factors:
    """L and U of a sparse matrix.

    Parameters
    ----------
    matrix : csc_array, (n, n)

    Raises
    ------
    FlowError
        For a singular matrix.
    """

    SINGULAR: Final = (
        "the equations have no single solution; give a pressure somewhere, and check for "
        "conditions that contradict each other"
    )

    def __init__(self, matrix: csc_array) -> None:
        try:
            self._lu: Any = splu(matrix)
        except RuntimeError as exc:
            raise FlowError(self.SINGULAR) from exc
        self._parts: Any = None

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the solution, (n,)."""
        if len(right) < LARGE:
            return np.asarray(self._lu.solve(right))
        return solve_triangles(right, *self.triangles())

    def triangles(self) -> tuple[Any, ...]:
        """What the kernels take: `_flat` parts of L and U, 1 over U's diagonal, and places."""
        if self._parts is None:
            inverse = 1.0 / self._lu.U.diagonal()
            lower = tril(csc_array(self._lu.L), -1, "csc")
            upper = triu(csc_array(self._lu.U), 1, "csc")
            upper.data *= inverse[upper.indices]
            self._parts = (
                *_flat(lower), *_flat(upper), inverse, self._lu.perm_r, self._lu.perm_c
            )  # fmt: skip
        return self._parts


def _flat(part: csc_array) -> tuple[Any, ...]:
    """Rows, columns and numbers of a triangle, column by column."""
    columns = np.repeat(np.arange(part.shape[1], dtype=np.int32), np.diff(part.indptr))
    return part.indices.astype(np.int32), columns, part.data


def by_rank(matrix: csr_array, place: Any) -> tuple[Any, ...]:
    """Rows (at their ``place``), columns and numbers: first the first of each row, and so on.

    Sums into one row then lie far apart, and none waits for the one before.
    """
    lengths = np.diff(matrix.indptr)
    row = np.repeat(np.arange(matrix.shape[0]), lengths)
    rank = np.arange(matrix.nnz) - np.repeat(matrix.indptr[:-1], lengths)
    order = np.argsort(rank, kind="stable")
    return (
        np.asarray(place)[row[order]].astype(np.int32),
        matrix.indices[order].astype(np.int32),
        matrix.data[order],
    )


@jit
def solve_triangles(
    right: FloatArray, lower_row: Any, lower_column: Any, lower: FloatArray, upper_row: Any,
    upper_column: Any, upper: FloatArray, inverse: FloatArray, row_place: Any, column_place: Any,
) -> FloatArray:  # fmt: skip
    """Solve L U x = right, rows and columns permuted as SuperLU says."""
    count = len(right)
    work = np.empty(count)
    for i in range(count):
        work[row_place[i]] = right[i]
    _eliminate(work, lower_row, lower_column, lower, upper_row, upper_column, upper, inverse)
    solution = np.empty(count)
    for i in range(count):
        solution[i] = work[column_place[i]]
    return solution


@jit
def _eliminate(
    work: FloatArray, lower_row: Any, lower_column: Any, lower: FloatArray, upper_row: Any,
    upper_column: Any, upper: FloatArray, inverse: FloatArray,
) -> None:  # fmt: skip
    """Solve L D U x = work in place, the diagonals of L and U 1.

    One loop over each triangle's numbers: with a loop a column, whose lengths are 0 to 4, half the
    time went into branches that the processor foresaw wrongly.
    """
    for k in range(len(lower)):
        work[lower_row[k]] -= lower[k] * work[lower_column[k]]
    for i in range(len(work)):
        work[i] *= inverse[i]
    for k in range(len(upper) - 1, -1, -1):
        work[upper_row[k]] -= upper[k] * work[upper_column[k]]


@jit
def step_linear(
    value: FloatArray, rate: FloatArray, constant: FloatArray, by_rate_row: Any,
    by_rate_column: Any, by_rate: FloatArray, by_value_row: Any, by_value_column: Any,
    by_value: FloatArray, tolerance: float, kept: float, passed: float, lower_row: Any,
    lower_column: Any, lower: FloatArray, upper_row: Any, upper_column: Any, upper: FloatArray,
    inverse: FloatArray, row_place: Any, column_place: Any, next_value: FloatArray,
    next_rate: FloatArray, work: FloatArray,
) -> None:  # fmt: skip
    """Find values and rates a step on, of a linear system: all of a step in one pass.

    The residual is P rate + F value + constant, the change x of the rates -residual through L U;
    the new rate is ``kept`` rate + x, the new value value + ``passed`` x.

    Parameters
    ----------
    constant : (n,) float64
        Rows in the order of L, as are those of P and F (`by_rank`).
    tolerance : float
        Largest residual that asks for no change.
    next_value, next_rate : (n,) float64
        Written.
    work : (n,) float64
        Scratch.
    """
    count = len(value)
    for i in range(count):
        work[i] = constant[i]
    for k in range(len(by_rate)):
        work[by_rate_row[k]] += by_rate[k] * rate[by_rate_column[k]]
    for k in range(len(by_value)):
        work[by_value_row[k]] += by_value[k] * value[by_value_column[k]]
    largest = 0.0
    for i in range(count):
        # Not `max`: what isn't a number has to go on, and to be told of at the end.
        if not abs(work[i]) <= largest:
            largest = abs(work[i])
    if largest < tolerance:
        work[:] = 0.0
    else:
        _eliminate(work, lower_row, lower_column, lower, upper_row, upper_column, upper, inverse)
    for i in range(count):
        change = -work[column_place[i]]
        next_rate[i] = kept * rate[i] + change
        next_value[i] = value[i] + passed * change
