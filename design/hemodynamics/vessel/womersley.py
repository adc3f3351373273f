"""Womersley factors: pressure drop and wall shear of oscillating flow over Poiseuille's.

In a rigid pipe, after Womersley 1955, doi 10.1113/jphysiol.1955.sp005276.
With α² = r² ω ϱ/μ and F = 2 J₁(i^{3/2} α) / (i^{3/2} α J₀(i^{3/2} α)), the pressure drop per
flow is that of Poiseuille times i α²/(8 (1 - F)), and the wall shear per flow that of Poiseuille
times i α² F/(8 (1 - F)). Both factors go to 1 for α → 0.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import jve

from design.units import WATER_DENSITY
from kernels.arrays import FloatArray

ComplexArray = NDArray[np.complex128]

QUASI_STEADY: Final = 1.0
"""Womersley numbers below it leave the profile a parabola that follows the pressure."""

_SERIES: Final = 0.3
"""Below it 1 - F loses digits to cancellation, and the series is right to 1e-10."""


def womersley_number(
    radius: FloatArray, omega: float, viscosity: FloatArray | float, density: float = WATER_DENSITY
) -> FloatArray:
    """α = r √(ω ϱ/μ); ``radius`` in mm, ``omega`` in rad/s, ``viscosity`` in Pa·s."""
    return np.asarray(radius * np.sqrt(omega * density / np.asarray(viscosity)))


def impedance_factor(alpha: FloatArray) -> ComplexArray:
    """Pressure drop of oscillating flow over Poiseuille's, same shape.

    Its series in s = iα² is that of (s/8) J₀/(J₀ - 2J₁/z), divided out.
    """
    s = 1j * np.asarray(alpha, dtype=np.float64) ** 2
    small = alpha < _SERIES
    series = 1.0 + s / 6.0 - s**2 / 1152.0 + s**3 / 34560.0 - 7.0 * s**4 / 6635520.0
    return np.where(small, series, s / 8.0 / (1.0 - _f(np.where(small, 1.0, alpha))))


def shear_factor(alpha: FloatArray) -> ComplexArray:
    """Wall shear of oscillating flow over that of Poiseuille's law, same shape.

    The momentum balance: τ = (r/2) (-dp/dx - iωϱQ/πr²), so the impedance's factor less iα²/8.
    """
    return impedance_factor(alpha) - 0.125j * np.asarray(alpha, dtype=np.float64) ** 2


def _f(alpha: FloatArray) -> ComplexArray:
    z = np.exp(0.75j * np.pi) * alpha
    # The exponentially scaled functions' factors cancel: no overflow at large α.
    return np.asarray(2.0 * jve(1, z) / (z * jve(0, z)))
