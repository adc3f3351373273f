"""Solve a matrix-free linear system by BiCGStab with a preconditioner."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from kernels.arrays import FloatArray

Operator = Callable[[FloatArray], FloatArray]


def bicgstab(
    apply: Operator, given: FloatArray, inverse: Operator, tolerance: float, most: int
) -> tuple[FloatArray, int]:
    """Solve ``apply(x) = given`` with a right preconditioner (van der Vorst 1992).

    SciPy's is the same; this one stops by the sum of sizes, in which a balance is told, and stops
    with the best it has instead of starting anew.

    Parameters
    ----------
    apply, inverse : functions of an array
        The operator, and about its inverse.
    given : (n,) float64
    tolerance : float
        Of the residual's sum of sizes over that of ``given``.
    most : int
        Steps at most.

    Returns
    -------
    (n,) float64 and int
        Solution, and how often ``inverse`` was applied.
    """
    x, rest = np.zeros_like(given), given.copy()
    goal = tolerance * float(np.abs(given).sum())
    shadow, direction = rest.copy(), rest.copy()
    rho, used = float(shadow @ rest), 0
    for _ in range(most):
        if float(np.abs(rest).sum()) <= goal or rho == 0.0:
            break
        ahead = inverse(direction)
        pushed = apply(ahead)
        alpha = rho / float(shadow @ pushed)
        rest -= alpha * pushed
        x += alpha * ahead
        used += 1
        if float(np.abs(rest).sum()) <= goal:
            break
        ahead = inverse(rest)
        turned = apply(ahead)
        size = float(turned @ turned)
        omega = float(turned @ rest) / size if size > 0.0 else 0.0
        x += omega * ahead
        rest -= omega * turned
        used += 1
        rho, before = float(shadow @ rest), rho
        if omega == 0.0:
            break
        direction -= omega * pushed
        direction *= rho / before * alpha / omega
        direction += rest
    return x, used
