"""Factorise a sparse matrix once and solve with it many times."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from scipy.sparse import csc_array, tril, triu
from scipy.sparse.linalg import splu

from design.errors import FlowError
from design.network import FloatArray
from kernels import jit

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
        """What the kernels take: L and U by columns without their diagonals, 1/U's, and places."""
        if self._parts is None:
            lower, upper = csc_array(self._lu.L), csc_array(self._lu.U)
            inverse = 1.0 / upper.diagonal()
            arrays = [x for m in (tril(lower, -1, "csc"), triu(upper, 1, "csc"))
                      for x in (m.indptr, m.indices, m.data)]  # fmt: skip
            self._parts = (*arrays, inverse, self._lu.perm_r, self._lu.perm_c)
        return self._parts


@jit
def solve_triangles(
    right: FloatArray, lower_start: Any, lower_row: Any, lower: FloatArray, upper_start: Any,
    upper_row: Any, upper: FloatArray, inverse: FloatArray, row_place: Any, column_place: Any,
) -> FloatArray:  # fmt: skip
    """Solve L U x = right, rows and columns permuted as SuperLU says."""
    count = len(right)
    work = np.empty(count)
    for i in range(count):
        work[row_place[i]] = right[i]
    _eliminate(work, lower_start, lower_row, lower, upper_start, upper_row, upper, inverse)
    found = np.empty(count)
    for i in range(count):
        found[i] = work[column_place[i]]
    return found


@jit
def _eliminate(
    work: FloatArray, lower_start: Any, lower_row: Any, lower: FloatArray, upper_start: Any,
    upper_row: Any, upper: FloatArray, inverse: FloatArray,
) -> None:  # fmt: skip
    """Solve L U x = work in place, by columns."""
    count = len(work)
    for j in range(count):
        known = work[j]
        for k in range(lower_start[j], lower_start[j + 1]):
            work[lower_row[k]] -= lower[k] * known
    for j in range(count - 1, -1, -1):
        known = work[j] * inverse[j]
        work[j] = known
        for k in range(upper_start[j], upper_start[j + 1]):
            work[upper_row[k]] -= upper[k] * known


@jit
def step_linear(
    value: FloatArray, rate: FloatArray, constant: FloatArray, by_rate_start: Any,
    by_rate_column: Any, by_rate: FloatArray, by_value_start: Any, by_value_column: Any,
    by_value: FloatArray, tolerance: float, kept: float, passed: float, lower_start: Any,
    lower_row: Any, lower: FloatArray, upper_start: Any, upper_row: Any, upper: FloatArray,
    inverse: FloatArray, row_place: Any, column_place: Any,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return values and rates a step on, of a linear system: all of a step in one pass.

    The residual is P rate + F value + constant (by rows), the change x of the rates -residual
    through L U; the new rate is ``kept`` rate + x, the new value value + ``passed`` x.

    Parameters
    ----------
    tolerance : float
        Largest residual that asks for no change.
    """
    count = len(value)
    work, next_value, next_rate = np.empty(count), np.empty(count), np.empty(count)
    largest = 0.0
    for i in range(count):
        left = constant[i]
        for k in range(by_rate_start[i], by_rate_start[i + 1]):
            left += by_rate[k] * rate[by_rate_column[k]]
        for k in range(by_value_start[i], by_value_start[i + 1]):
            left += by_value[k] * value[by_value_column[k]]
        work[row_place[i]] = left
        # Not `max`: what isn't a number has to go on, and to be told of at the end.
        if not abs(left) <= largest:
            largest = abs(left)
    if largest < tolerance:
        work[:] = 0.0
    else:
        _eliminate(work, lower_start, lower_row, lower, upper_start, upper_row, upper, inverse)
    for i in range(count):
        change = -work[column_place[i]]
        next_rate[i] = kept * rate[i] + change
        next_value[i] = value[i] + passed * change
    return next_value, next_rate
