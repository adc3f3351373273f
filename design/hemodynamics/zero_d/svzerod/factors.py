"""Factorise a sparse matrix once and solve with it many times."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from design.errors import FlowError
from design.network import FloatArray
from kernels import jit

_LARGE: Final = 2000
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
        if len(right) < _LARGE:
            return np.asarray(self._lu.solve(right))
        if self._parts is None:
            lower, upper = csc_array(self._lu.L), csc_array(self._lu.U)
            for part in (lower, upper):
                part.sort_indices()
            arrays = [x for m in (lower, upper) for x in (m.indptr, m.indices, m.data)]
            self._parts = (*arrays, self._lu.perm_r, self._lu.perm_c)
        return solve_triangles(right, *self._parts)


@jit
def solve_triangles(
    right: FloatArray, lower_start: Any, lower_row: Any, lower: FloatArray, upper_start: Any,
    upper_row: Any, upper: FloatArray, row_place: Any, column_place: Any,
) -> FloatArray:  # fmt: skip
    """Solve L U x = right, by columns, rows and columns permuted as SuperLU says.

    Each column's rows are sorted: its diagonal is L's first entry, which is 1, and U's last.
    """
    count = len(right)
    work = np.empty(count)
    for i in range(count):
        work[row_place[i]] = right[i]
    for j in range(count):
        known = work[j]
        if known != 0.0:
            for k in range(lower_start[j] + 1, lower_start[j + 1]):
                work[lower_row[k]] -= lower[k] * known
    for j in range(count - 1, -1, -1):
        diagonal = upper_start[j + 1] - 1
        known = work[j] / upper[diagonal]
        work[j] = known
        if known != 0.0:
            for k in range(upper_start[j], diagonal):
                work[upper_row[k]] -= upper[k] * known
    found = np.empty(count)
    for i in range(count):
        found[i] = work[column_place[i]]
    return found
