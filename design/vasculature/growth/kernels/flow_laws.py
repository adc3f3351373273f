"""Powers of resistance and length by a tree's law of radii (compiled)."""

from __future__ import annotations

from math import sqrt

import numpy as np

from design.vasculature.options import Law
from kernels import jit


@jit
def to_gamma(resistance: float, law: Law) -> float:
    """W^(γ/4)."""
    if law.gamma == 3.0:
        return sqrt(resistance * sqrt(resistance))
    return resistance ** (0.25 * law.gamma)


@jit
def from_gamma(total: float, law: Law) -> float:
    """S^(4/γ), the inverse of `to_gamma`."""
    if law.gamma == 3.0:
        return total * np.cbrt(total)
    return total ** (4.0 / law.gamma)


@jit
def to_lambda(resistance: float, law: Law) -> float:
    """W^(λ/4)."""
    if law.lam == 2.0:
        return sqrt(resistance)
    return resistance ** (0.25 * law.lam)


@jit
def to_u(length: float, law: Law) -> float:
    """ℓᵘ."""
    if law.u == 1.0:
        return length
    return length**law.u
