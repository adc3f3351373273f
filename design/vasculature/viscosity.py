"""Compute blood viscosity at a vessel radius and haematocrit, relative to wide vessels.

Pries et al. 1994 (doi 10.1161/01.RES.75.5.904), the in vivo law, with D in µm and the discharge
haematocrit H:

- μ_0.45 = 6 e^(-0.085 D) + 3.2 - 2.44 e^(-0.06 D^0.645)
- C = (0.8 + e^(-0.075 D)) (-1 + 1/(1 + 10^-11 D^12)) + 1/(1 + 10^-11 D^12)
- μ(D, H) = μ_plasma [1 + (μ_0.45 - 1) ((1-H)^C - 1)/(0.55^C - 1) s] s,  s = (D/(D - 1.1))²

For D to infinity C = -0.8, μ_0.45 = 3.2 and s = 1. Here μ(D, H)/μ(∞, H) is used, so that the
viscosity asked for is that of wide vessels: 4 mPa·s at H = 0.45 means a plasma of 1.25 mPa·s. The
law rests on measurements in vessels of some 4 to 60 µm and on glass tubes up to 1 mm; below 4 µm
its value at 4 µm is taken.
"""

from __future__ import annotations

from math import exp

from kernels import jit
from kernels.arrays import FloatArray

NARROWEST_UM = 4.0
"""Diameter below which the law isn't followed further."""
SETTLED = 1e-13
"""Viscosities are settled when none changes by more, relatively."""
ROUNDS = 200
"""Of settling, at most."""


@jit
def relative_viscosity(radius_mm: float, haematocrit: float) -> float:
    """Viscosity at a radius over that in wide vessels; 1 for ``haematocrit`` below 0."""
    if haematocrit < 0.0:
        return 1.0
    d = max(2e3 * radius_mm, NARROWEST_UM)
    at_45 = 6.0 * exp(-0.085 * d) + 3.2 - 2.44 * exp(-0.06 * d**0.645)
    wide = 1.0 / (1.0 + 1e-11 * d**12)
    c = (0.8 + exp(-0.075 * d)) * (wide - 1.0) + wide
    s = (d / (d - 1.1)) ** 2
    here = (1.0 + (at_45 - 1.0) * _cells(c, haematocrit) * s) * s
    return float(here / (1.0 + 2.2 * _cells(-0.8, haematocrit)))


@jit
def _cells(c: float, haematocrit: float) -> float:
    """Dependence on the haematocrit, 1 at 0.45."""
    return float(((1.0 - haematocrit) ** c - 1.0) / (0.55**c - 1.0))


@jit
def relative_viscosities(radius: FloatArray, haematocrit: float, viscosity: FloatArray) -> None:
    """Write the viscosity at radii (n,), mm, over that in wide vessels into ``viscosity`` (n,)."""
    for k in range(len(radius)):
        viscosity[k] = relative_viscosity(radius[k], haematocrit)
