"""Solve finite-element linear systems together with a few unknown port pressures, by GMRES.

    A x + B λ = r,    Bᵀ x - D λ = s

where B's columns are the flows out of ports and D what an outlet lets through for its pressure.
Krylov steps (GMRES) on the whole, preconditioned by a factor of A's symmetric part, or of A at an
earlier state, bordered exactly: one solve a column, once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError

Array = NDArray[Any]
Apply = Callable[[Array], Array]

STEPS: Final = 150
"""Krylov steps at most, unless told."""

_CHUNK: Final = 24


@dataclass(frozen=True)
class BorderBlocks:
    """B (n, m), D (m,), and the factor's answer to B's columns."""

    columns: Array
    slope: Array
    answered: Array
    schur: Array

    @staticmethod
    def around(solve: Apply, columns: Array, slope: Array, free: NDArray[np.bool_]) -> BorderBlocks:
        """Prepare for a factor."""
        columns = columns * free[:, None]
        answered = np.stack([solve(c) for c in columns.T], axis=1) if columns.size else columns
        return BorderBlocks(columns, slope, answered, np.diag(slope) + columns.T @ answered)


def solve_bordered(
    times: Apply,
    solve: Apply,
    border: BorderBlocks,
    right: Array,
    free: NDArray[np.bool_],
    rtol: float,
    steps: int = STEPS,
) -> tuple[Array, int]:
    """The unknowns x and λ, one after the other, and the Krylov steps taken.

    Raises
    ------
    FlowError
        When they don't converge.
    """
    count = len(free)

    def operator(whole: Array) -> Array:
        x, multiplier = whole[:count], whole[count:]
        first = free * (times(x) + border.columns @ multiplier)
        return np.concatenate([first, border.columns.T @ x - border.slope * multiplier])

    def precondition(whole: Array) -> Array:
        x = solve(whole[:count])
        if not len(border.slope):
            return x
        multiplier = np.linalg.solve(border.schur, border.columns.T @ x - whole[count:])
        return np.concatenate([x - border.answered @ multiplier, multiplier])

    return _gmres(operator, precondition, right, rtol, steps)


def _gmres(
    operator: Apply, precondition: Apply, right: Array, rtol: float, steps: int
) -> tuple[Array, int]:
    """Right-preconditioned, so that it measures the true residual (Saad 2003, §9.3.2)."""
    norm = float(np.linalg.norm(right))
    if norm == 0.0:
        return np.zeros_like(right), 0
    basis = np.empty((min(steps, _CHUNK) + 1, len(right)), dtype=right.dtype)
    basis[0] = right / norm
    hessenberg = np.zeros((steps + 1, steps), dtype=right.dtype)
    for k in range(steps):
        new = operator(precondition(basis[k]))
        for _ in range(2):  # twice is enough to stay orthogonal
            part = basis[: k + 1] @ new
            hessenberg[: k + 1, k] += part
            new = new - part @ basis[: k + 1]
        hessenberg[k + 1, k] = np.linalg.norm(new)
        weight, left = _least(hessenberg[: k + 2, : k + 1], norm)
        if left <= rtol:
            return precondition(weight @ basis[: k + 1]), k + 1
        if k + 2 > len(basis):
            basis = np.concatenate([basis, np.empty((_CHUNK, len(right)), dtype=right.dtype)])
        basis[k + 1] = new / hessenberg[k + 1, k]
    raise FlowError(
        f"the linear solver is left with {left:.2g} of its residual after {steps} steps "
        f"({rtol:.1g} asked): convection is too strong for it; lower the flow, or refine the mesh"
    )


def _least(square: Array, norm: float) -> tuple[Array, float]:
    """Weights of the basis that leave the least of the residual, and what part they leave."""
    target = np.zeros(len(square), dtype=square.dtype)
    target[0] = norm
    weight = np.linalg.lstsq(square, target, rcond=None)[0]
    return weight, float(np.linalg.norm(square @ weight - target)) / norm
