"""Solve small dense least-squares problems by Levenberg-Marquardt with numerical derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from kernels.arrays import FloatArray

_STEP: Final = 1e-6
_ROUNDS: Final = 60
_REST: Final = 1e-10
"""Relative gain of the cost below which it has come to rest."""


def settle(
    residuals: Callable[[FloatArray], FloatArray], start: FloatArray, sizes: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Minimise the sum of squares.

    Not SciPy's: its singular value decomposition of a few hundred rows keeps all cores busy.

    Parameters
    ----------
    residuals : callable
        (k,) of unknowns (n,).
    start : (n,) float64
    sizes : (n,) float64
        Of a change of each unknown that matters.

    Returns
    -------
    unknowns : (n,) float64
    normal : (n, n) float64
        Slopes' products JᵀJ there.

    None where it doesn't come to rest.

    Notes
    -----
    Marquardt 1963, J. SIAM 11, 431, doi 10.1137/0111030.
    """
    at, left = start.copy(), residuals(start)
    damping = 1e-4
    for _ in range(_ROUNDS):
        by = slopes(residuals, at, left, sizes)
        normal, pull = by.T @ by, by.T @ left
        gain = 0.0
        while damping < 1e12:
            held = normal + damping * np.diag(np.diag(normal))
            tried = at - np.linalg.solve(held, pull)
            then = residuals(tried)
            gain = float(left @ left - then @ then)
            if gain >= 0:
                break
            damping *= 10
        if gain < 0 or not np.isfinite(left).all():
            return None
        rest = gain <= _REST * float(left @ left)
        at, left, damping = tried, then, max(damping / 10, 1e-12)
        if rest:
            scaled = normal * np.outer(sizes, sizes)
            return (at, normal) if np.linalg.cond(scaled) < 1e15 else None
    return None


def slopes(
    residuals: Callable[[FloatArray], FloatArray],
    at: FloatArray,
    left: FloatArray,
    sizes: FloatArray,
) -> FloatArray:
    """Slopes (k, n) of the residuals ``left`` (k,) at the unknowns, by differences."""
    columns = np.empty((len(left), len(at)))
    for n, size in enumerate(sizes):
        moved = at.copy()
        moved[n] += _STEP * size
        columns[:, n] = (residuals(moved) - left) / (_STEP * size)
    return columns
